"""One function on many items: in processes that can be stopped, or on a Dask cluster. See ``workers.run_tasks``."""
