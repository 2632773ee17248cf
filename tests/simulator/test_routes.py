"""Routes and options: what is walked, and what is refused."""
