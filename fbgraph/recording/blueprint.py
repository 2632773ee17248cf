"""How a recording opens in Rerun: tabs by question, the first of them enough to understand the walk."""

from __future__ import annotations

from collections.abc import Collection

import rerun.blueprint as rrb

from fbgraph.recording.map_frame import Frame
from fbgraph.recording.tab_layout import question_tabs


def blueprint(entities: Collection[str], frame: Frame | None = None, active_tab: int = 0) -> rrb.Blueprint:
    """The arrangement of views.

    Args:
        entities: paths that were written; views of what is not there are left out.
        frame: what the map shows; all there is if None.
        active_tab: which tab is open.
    """
    return arranged(rrb.Tabs(*question_tabs(entities, frame), active_tab=active_tab))


def arranged(root: rrb.Tabs) -> rrb.Blueprint:
    """The whole window: no panels, the cursor at the end of the walk, which it follows while it goes on."""
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
    )
