"""Holds the German of the refusals of calibration files, and of the damages of the history of references."""

GERMAN_OF_CALIBRATIONS = {
    # the file
    "is empty": "ist leer",
    "Copy it again": "Sie noch einmal kopieren",
    "Give a .toml or a PLUS .xml file": "Eine .toml oder eine .xml von PLUS angeben",
    "is a bare matrix of 4 x 4 numbers": "ist eine bloße Matrix von 4 x 4 Zahlen",
    'Write a .toml: format = "probewatch-calibration", version = 1, image_size_px = [width, height] and '
    "image_to_probe = [[…], […], […], [0, 0, 0, 1]], its rows, px to mm": (
        'Eine .toml schreiben: format = "probewatch-calibration", version = 1, image_size_px = [Breite, Höhe] und '
        "image_to_probe = [[…], […], […], [0, 0, 0, 1]], ihre Zeilen, px nach mm"
    ),
    "is {said}, not a calibration": "ist {said}, keine Kalibrierung",
    "is {said}, not a calibration file": "ist {said}, keine Kalibrierdatei",
    "probewatch calibration import makes a .toml of it": "probewatch calibration import macht daraus eine .toml",
    "is a calibration of probewatch already": "ist schon eine Kalibrierung von probewatch",
    "Give it to the service: probewatch calibration use {text}": (
        "Sie dem Dienst geben: probewatch calibration use {text}"
    ),
    "is not valid TOML: {text}": "ist kein gültiges TOML: {text}",
    "Mend that line: a number begins with a digit (0.1), a text stands in quotes": (
        "Die Zeile berichtigen: eine Zahl beginnt mit einer Ziffer (0.1), ein Text steht in Anführungszeichen"
    ),
    "is neither TOML nor XML: {text}": "ist weder TOML noch XML: {text}",
    "Save it as UTF-8": "Sie als UTF-8 speichern",
    "image_size_px is {text}, the pictures are {what}": "image_size_px ist {text}, die Bilder haben {what}",
    "Give the calibration that belongs to this scanner setting": (
        "Die Kalibrierung angeben, die zu dieser Einstellung des Ultraschallgeräts gehört"
    ),
    "rotation is not a rotation matrix": "rotation ist keine Drehmatrix",
    "Its rows must be a right-handed orthonormal frame; restore the file or calibrate again": (
        "Ihre Zeilen müssen ein rechtshändiges Orthonormalsystem sein; die Datei wiederherstellen oder neu kalibrieren"
    ),
    # kinds of file
    "a ROS bag": "ein ROS-Bag",
    "a black box or a ROS bag (MCAP)": "eine Blackbox oder ein ROS-Bag (MCAP)",
    "a database, perhaps a ROS bag (db3)": "eine Datenbank, vielleicht ein ROS-Bag (db3)",
    "a DICOM file": "eine DICOM-Datei",
    "an HDF5 file": "eine HDF5-Datei",
    "a MATLAB file": "eine MATLAB-Datei",
    "a single picture (PNG)": "ein einzelnes Bild (PNG)",
    "a single picture (JPEG)": "ein einzelnes Bild (JPEG)",
    "a single picture (BMP)": "ein einzelnes Bild (BMP)",
    "a TIFF picture": "ein TIFF-Bild",
    "a NumPy array": "ein NumPy-Array",
    "a NIfTI volume": "ein NIfTI-Volumen",
    "a VTK file": "eine VTK-Datei",
    "a GIF": "ein GIF",
    "a JSON file": "eine JSON-Datei",
    "an NRRD file": "eine NRRD-Datei",
    "a MetaImage": "ein MetaImage",
    "a film": "ein Film",
    # ImageToProbe
    "ImageToProbe has a number that is not finite": "ImageToProbe hat eine Zahl, die nicht endlich ist",
    "Calibrate the probe again, or restore the file": ("Die Sonde neu kalibrieren, oder die Datei wiederherstellen"),
    "ImageToProbe has the last row {text}, not 0 0 0 1": "ImageToProbe hat als letzte Zeile {text}, nicht 0 0 0 1",
    "It is transposed: write it row by row": "Sie ist transponiert: zeilenweise schreiben",
    "ImageToProbe has scales {text} and {times} mm/px, not within 0.001 to 10": (
        "ImageToProbe hat die Maßstäbe {text} und {times} mm/px, nicht 0.001 bis 10"
    ),
    "Is it in metres? Multiply its upper three rows by 1000": (
        "Ist sie in Metern? Die oberen drei Zeilen mit 1000 multiplizieren"
    ),
    "Is it the inverse, ProbeToImage, or in µm? Invert it, or divide its upper three rows by 1000": (
        "Ist sie die Inverse, ProbeToImage, oder in µm? Sie invertieren, oder die oberen drei Zeilen durch 1000 teilen"
    ),
    "Is it in µm? Divide its upper three rows by 1000": "Ist sie in µm? Die oberen drei Zeilen durch 1000 teilen",
    "ImageToProbe has scales of exactly 1 mm/px: the placeholder of a probe that was never calibrated": (
        "ImageToProbe hat Maßstäbe von genau 1 mm/px: der Platzhalter einer Sonde, die nie kalibriert wurde"
    ),
    "Calibrate it (docs/recalibration.md, --solve all), or give its file": (
        "Sie kalibrieren (docs/recalibration.md, --solve all), oder ihre Datei angeben"
    ),
    "ImageToProbe makes the picture {text} m large": "ImageToProbe macht das Bild {text} m groß",
    "Is it the inverse, ProbeToImage? Invert it; its columns are mm per pixel": (
        "Ist sie die Inverse, ProbeToImage? Sie invertieren; ihre Spalten sind mm je Pixel"
    ),
    "ImageToProbe puts the picture {text} m from the marker body": (
        "ImageToProbe setzt das Bild {text} m vom Markerkörper weg"
    ),
    "Give its last column in mm, and the marker body of the probe": (
        "Ihre letzte Spalte in mm angeben, und den Markerkörper der Sonde"
    ),
    "ImageToProbe is sheared: the cosine of its picture axes is {text}": (
        "ImageToProbe ist geschert: der Kosinus der Bildachsen ist {text}"
    ),
    "ImageToProbe is sheared: its third axis is {text}° off": (
        "ImageToProbe ist geschert: die dritte Achse liegt {text}° daneben"
    ),
    "ImageToProbe is mirrored: its third axis points against the picture's normal": (
        "ImageToProbe ist gespiegelt: die dritte Achse zeigt gegen die Normale des Bildes"
    ),
    # the history of references
    "which calibration is in force is not known": "welche Kalibrierung gilt, ist nicht bekannt",
    "is missing, although references were kept": "fehlt, obwohl Referenzen aufbewahrt wurden",
    "is too large": "ist zu groß",
    "does not match its checksum": "passt nicht zur Prüfsumme",
    "cannot be understood": "ist nicht zu verstehen",
    "was changed: it is not the content of reference {number}": (
        "wurde geändert: es ist nicht der Inhalt von Referenz {number}"
    ),
    "the content of reference {number} is missing ({text})": "der Inhalt von Referenz {number} fehlt ({text})",
    "Restore the folder from a copy, or start again with the configuration's file: probewatch calibration reset": (
        "Den Ordner aus einer Kopie wiederherstellen, oder mit der Datei der Konfiguration neu beginnen: probewatch "
        "calibration reset"
    ),
    "a service is running": "ein Dienst läuft",
    "Stop it first: {text}": "Ihn zuerst anhalten: {text}",
    "cannot be set aside ({said})": "lässt sich nicht beiseitelegen ({said})",
    "Run the command as the service's user, or as root": (
        "Den Befehl als Benutzer des Dienstes ausführen, oder als root"
    ),
}
