"""The Rerun recording and the live view: what is logged, where it is drawn, how it opens."""
