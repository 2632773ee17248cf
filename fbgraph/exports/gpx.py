"""GPX 1.1: a track of every breadcrumb with height and, where the log knows the date, time; its events as waypoints."""

from __future__ import annotations

from typing import BinaryIO

from fbgraph.core.safe_text import for_xml
from fbgraph.exports.exported_walk import ExportedWalk

DESCRIPTION = "a track with height and time, for any map or hiking app"
SUFFIX, BINARY, ON_EARTH = ".gpx", False, True


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it."""
    from gpxpy import gpx as xml  # here, because only GPX needs it

    origin, way = walk.on_map
    notes = [*walk.heights_note, *walk.undated_note]
    document = xml.GPX()
    document.creator, document.name = "fbgraph", for_xml(walk.title)
    document.description = for_xml(" ".join((*walk.caution, *(f"{note}." for note in notes)))) or None
    heights_m = walk.heights_m
    heights = [None] * len(way) if heights_m is None else heights_m.tolist()
    points = [
        xml.GPXTrackPoint(lat, lon, elevation=height, time=walk.moment(t_s))
        for (lon, lat), height, t_s in zip(walk.lon_lat(way, origin).tolist(), heights, way.t_s.tolist(), strict=True)
    ]
    track = xml.GPXTrack(name=document.name)
    track.segments.append(xml.GPXTrackSegment(points))
    document.tracks.append(track)
    for t_s, label, (lon, lat) in walk.marks(way, origin):
        document.waypoints.append(xml.GPXWaypoint(lat, lon, name=for_xml(label), time=walk.moment(t_s)))
    out.write((str(document.to_xml("1.1")) + "\n").encode())
    return notes
