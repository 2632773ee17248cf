"""What the columns of a table may be, by their names, units and place: proposals, which physics tries."""
