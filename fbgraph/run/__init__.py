"""What a run found: its result, scores, findings, summary and folder."""
