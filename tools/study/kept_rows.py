"""Refuses to go on with a table whose rows of recordings were made of other files than those that are given now."""

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.study.archive import CALIBRATION, NAMES, STATE, ArchiveTask
from probewatch.tools.study.table import StudyTable


def refuse_other_calibration(archive: list[ArchiveTask], table: StudyTable) -> None:
    """Raises ConfigurationError where a recording has a row judged by another calibration: the row would be kept."""
    by = {row["recording"]: row[CALIBRATION] for row in table.rows}
    for task in archive:
        kept = by.get(str(task.recording), task.judged_by)
        if kept != task.judged_by:
            what = f"has {task.recording} as judged by {_named(kept)}; now it would be by {_named(task.judged_by)}"
            raise ConfigurationError(what, str(table.path), "Give another folder with --output")


def refuse_changed(archive: list[ArchiveTask], table: StudyTable) -> None:
    """Raises ConfigurationError where a recording has a row of other content or tool names: the row would be kept."""
    by = {row["recording"]: row for row in table.rows}
    for task in archive:
        kept = by.get(str(task.recording))
        if kept is not None and not task.is_of(kept):
            what = f"has {task.recording} as it was ({kept[STATE]}); it has changed since ({task.state})"
            remedy = "Take its line out to have it judged again, or give another folder with --output"
            raise ConfigurationError(what, str(table.path), remedy)
        if kept is not None and kept[NAMES] != task.names:
            what = f"has {task.recording} with {kept[NAMES] or 'the usual names'}, now {task.names or 'the usual ones'}"
            raise ConfigurationError(what, str(table.path), "Give another folder with --output")


def _named(sha256: str) -> str:
    return f"the calibration with SHA-256 {sha256[:12]}…" if sha256 else "that of the black box"
