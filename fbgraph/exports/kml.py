"""KML 2.2: the walk as a line on the ground, its breadcrumbs in a folder of their own, and its events."""

from __future__ import annotations

from typing import BinaryIO
from xml.etree import ElementTree as Xml

from fbgraph.core.safe_text import for_xml
from fbgraph.exports.exported_walk import ExportedWalk

DESCRIPTION = "a line on the ground and its breadcrumbs, for Google Earth"
SUFFIX, BINARY, ON_EARTH = ".kml", False, True
NAMESPACE = "http://www.opengis.net/kml/2.2"


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it."""
    origin, way = walk.on_map
    notes = [*walk.heights_note, *walk.undated_note]
    heights_m = walk.heights_m
    heights = [""] * len(way) if heights_m is None else [f",{height:.3f}" for height in heights_m.tolist()]
    places = [
        f"{lon:.7f},{lat:.7f}{height}"
        for (lon, lat), height in zip(walk.lon_lat(way, origin).tolist(), heights, strict=True)
    ]
    root = Xml.Element("kml", xmlns=NAMESPACE)
    document = _add(root, "Document")
    _add(document, "name", for_xml(walk.title))
    _add(document, "description", for_xml(" ".join((*walk.caution, *(f"{note}." for note in notes)))))
    line = _add(_placemark(document, walk.title), "LineString")
    _add(line, "tessellate", "1")
    _add(line, "altitudeMode", "clampToGround")
    _add(line, "coordinates", " ".join(places))
    for t_s, label, (lon, lat) in walk.marks(way, origin):
        _point(walk, document, label, t_s, f"{lon:.7f},{lat:.7f}")
    folder = _add(document, "Folder")
    _add(folder, "name", "breadcrumbs")
    _add(folder, "visibility", "0")
    for place, state in zip(places, walk.states(way), strict=True):
        _point(walk, folder, str(state.pop("k")), state.pop("t_s"), place, state)
    Xml.indent(root, " ")
    Xml.ElementTree(root).write(out, "utf-8", xml_declaration=True)
    out.write(b"\n")
    return notes


def _point(
    walk: ExportedWalk,
    parent: Xml.Element,
    name: str,
    t_s: float,
    place: str,
    known: dict[str, float | None] | None = None,
) -> None:
    mark = _placemark(parent, name)
    if (moment := walk.moment(t_s)) is not None:
        _add(_add(mark, "TimeStamp"), "when", moment.isoformat(timespec="milliseconds").replace("+00:00", "Z"))
    data = _add(mark, "ExtendedData")
    for key, value in {"t_s": round(t_s, 6), **(known or {})}.items():
        if value is not None:
            _add(_add(data, "Data", name=key), "value", f"{value:.6f}")
    _add(_add(mark, "Point"), "coordinates", place)


def _placemark(parent: Xml.Element, name: str) -> Xml.Element:
    mark = _add(parent, "Placemark")
    _add(mark, "name", for_xml(name))
    return mark


def _add(parent: Xml.Element, tag: str, text: str | None = None, **attributes: str) -> Xml.Element:
    child = Xml.SubElement(parent, tag, attributes)
    child.text = text
    return child
