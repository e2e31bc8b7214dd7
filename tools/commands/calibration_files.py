"""`probewatch calibration export` and `import`: write a reference for other programs, and read their files."""

import hashlib
from pathlib import Path

import click

from probewatch.appliance.storage.calibration_exchange import device_set_text, itk_text, read_itk
from probewatch.appliance.storage.calibration_file import (
    ITK_BEGINS,
    calibration_bytes,
    check_own_name,
    is_device_set,
    read_calibration,
    refuse_other_kind,
    refuse_toml,
    write_calibration,
)
from probewatch.appliance.storage.device_set import clip_px, not_kept, remarks
from probewatch.appliance.storage.reference import candidate_from_content
from probewatch.appliance.storage.reference_store import content_of
from probewatch.appliance.types import Calibration
from probewatch.drivers.files.atomic_file import check_new, writing
from probewatch.tools.german.translation import told
from probewatch.tools.shared.alarm_history import references_in
from probewatch.tools.shared.named_cart import cart_language, folder_option


@click.command(short_help="write a reference for PLUS (.xml) or 3D Slicer (.tfm)")
@click.argument("source")
@click.option("--output", required=True, type=click.Path(path_type=Path), help="new file, .xml or .tfm")
@click.option("--probe", default="Probe", show_default=True, help="name of the marker body in the device set")
@click.option(
    "--image-size", nargs=2, type=click.IntRange(16, 16_384), help="of SOURCE, where the file does not state it"
)
@folder_option
def export(source: str, output: Path, probe: str, image_size: tuple[int, int] | None, folder: Path) -> None:
    """Write SOURCE, the number of a reference or a file, for another program.

    .xml is a device set of the PLUS toolkit with the transform Image to Probe, .tfm an ITK text transform that 3D
    Slicer loads; HDF5 (.h5) is not written. Both keep every number to 1e-9; neither holds sigmas or who signed.

    \b
    Example:
      probewatch calibration export 3 --output probe.xml
    """
    if output.suffix not in (".xml", ".tfm"):
        raise click.UsageError("--output ends in .xml or .tfm")
    check_new(output)
    calibration = NamedReference(source, folder).calibration(image_size)
    text = device_set_text(calibration, probe) if output.suffix == ".xml" else itk_text(calibration)
    with writing(output) as stream:
        stream.write(text.encode())
    click.echo(told("written: {file}", cart_language(), file=output))


@click.command(name="import", short_help="convert a PLUS .xml or a 3D Slicer .tfm to a calibration file")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--output", required=True, type=click.Path(path_type=Path), help="new file, .toml")
@click.option("--image-size", nargs=2, type=click.IntRange(16, 16_384), help="width and height, px [PLUS's clip]")
@click.option("--probe", default="Probe", show_default=True, help="marker body, or whole transform: LeftImageToProbe")
def import_file(file: Path, output: Path, image_size: tuple[int, int] | None, probe: str) -> None:
    """Make our calibration file of FILE, a device set of PLUS or an ITK text transform (.tfm).

    Neither states the size of the pictures, to which the origin refers, nor any sigma: give --image-size of the
    pictures as the service will see them, unless PLUS says which part of them it cuts out (ClipRectangleSize). What
    else PLUS states about the devices is printed. `probewatch calibration use` gives the new file to the service.

    \b
    Example:
      probewatch calibration import probe.tfm --image-size 640 480 --output probe.toml
    """
    check_own_name(output)
    check_new(output)
    content = calibration_bytes(file)
    is_itk = file.suffix == ".tfm" or content.startswith(ITK_BEGINS)
    if not is_itk:
        refuse_other_kind(content, file)
        refuse_toml(content, file)
    clip = clip_px(content)
    if image_size is None and clip is None:
        raise click.UsageError("Missing option '--image-size': the file does not say how large the pictures are")
    size = image_size or (clip or (0, 0, 0, 0))[2:]
    calibration = read_itk(file, size) if is_itk else read_calibration(file, size, probe)
    for remark in (*remarks(content, size), *not_kept(content)):
        click.secho(remark, err=True, fg="yellow")
    digest = hashlib.sha256(content).hexdigest()
    write_calibration(output, calibration, {"input": str(file.absolute()), "input_sha256": digest})
    click.echo(told("written: {file}", cart_language(), file=output))


class NamedReference:
    """Represents a reference that is named by its number or by a file. `size_px` is (width, height) of its pictures,
    None where the file does not state it.
    """

    def __init__(self, name: str, folder: Path) -> None:
        entry = references_in(folder).entry(int(name)) if name.isdecimal() else None
        self._content = calibration_bytes(Path(name)) if entry is None else content_of(folder, entry)
        self._file, self._probe = (name, "Probe") if entry is None else (entry.file, entry.probe)
        self.size_px = None if entry is None else entry.image_size_px
        if entry is None and not is_device_set(self._content):
            self.size_px = self.calibration(None).image_size_px

    def calibration(self, other_px: tuple[int, int] | None) -> Calibration:
        """Returns the calibration. other_px: the size of the pictures where a device set does not state it."""
        needed_px = self.size_px or (other_px if is_device_set(self._content) else None)
        return candidate_from_content(self._content, self._file, needed_px, self._probe).calibration
