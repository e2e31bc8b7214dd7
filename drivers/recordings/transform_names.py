"""Finds the transforms of a recording that make the pose of the probe, and advises where they have other names."""

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.advice import POSES_APART
from probewatch.drivers.recordings.sequence import Sequence


def transform_names(
    poses: Sequence, probe: str, reference: str | None, required: bool
) -> tuple[str | None, str | None]:
    """Returns (transform of the tool, transform of the reference or None) by the rule of open_recording.

    Where the transforms are missing, raises RecordingError if they are required, and returns None for both if not.
    """
    there = poses.transform_names()
    target = reference or "Reference"
    direct, tool, fixed = f"{probe}To{target}", f"{probe}ToTracker", f"{target}ToTracker"
    if direct in there:
        return direct, None
    if probe == target and tool in there:
        what = f"takes {tool} as probe and as reference: its pose relative to itself never changes"
        raise RecordingError(what, str(poses.path), "Name the reference tool with --reference, or Tracker for none")
    if tool in there and (fixed in there or reference is None):
        return tool, fixed if fixed in there else None
    if not required:
        return None, None
    names = ", ".join(there) if there else "none"
    wanted = f"has neither {direct} nor {tool}{f' with {fixed}' if reference else ''}"
    what = f"{f'has no {tool}' if direct == tool else wanted}; its transforms: {names}"
    if tool in there:
        remedy = "Name the reference tool with --reference, or Tracker where there is none"
        raise RecordingError(what, str(poses.path), remedy)
    if misnamed := [name for name in poses.misnamed() if name not in there]:
        what += f"; sixteen numbers without the ending Transform: {', '.join(misnamed)}"
        likely = next((name for name in misnamed if name.lower() in (direct.lower(), tool.lower())), misnamed[0])
        named = direct if likely.lower() == direct.lower() else tool
        raise RecordingError(what, str(poses.path), f"Call {likely} {named}Transform in each frame, as PLUS does")
    raise RecordingError(what, str(poses.path), _how_to_name(there))


def _how_to_name(there: list[str]) -> str:
    """Returns what to do about a pose that has another name, judged by the transforms that are there."""
    parts = [name.rpartition("To") for name in there]
    ends = "Reference", "Tracker"
    tools = {tool for tool, _, end in parts if tool not in ("", "Reference", "Image") and end in ends}
    if not there:
        return f"Give a recording that holds its poses; {POSES_APART}, a sequence or a table"
    inverse = [f"{begin}To{end}" for begin, _, end in parts if begin in ends and end not in (*ends, "Image")]
    if not tools and inverse:
        return (
            f"{inverse[0]} is the other way round: write its inverse, from the tool to {inverse[0].partition('To')[0]}"
        )
    if not tools and any(begin == "Image" for begin, _, _ in parts):
        return "ImageTo… has the calibration in it: record the pose of the tool, such as ProbeToTracker"
    if not tools:
        return f"Name the tool with --probe and --reference; {POSES_APART}"
    listed = " or ".join(f"--probe {name}" for name in sorted(tools))
    return f"Say which of them is on the ultrasound probe: {listed}; {POSES_APART}"


def witness_name(poses: Sequence, tool: str | None, fixed: str | None, probe: str, witness: str | None) -> str | None:
    """Returns the name of the transform of the second body, into the frame of the probe's pose; None where none was
    named and none is there. tool, fixed: as transform_names returns them. Raises RecordingError where one was named and
    is missing, or is the probe or the reference.
    """
    if tool is None:
        return None
    name = f"{witness or 'Witness'}{tool.removeprefix(probe)}"
    there, taken = poses.transform_names(), name in (tool, fixed)
    if name in there and not taken:
        return name
    if witness is None:
        return None
    what = f"has no {name}; its transforms: {', '.join(there)}"
    what = f"has {name} as the probe or the reference already: it is no second body" if taken else what
    raise RecordingError(what, str(poses.path), "Name a second body of the probe")
