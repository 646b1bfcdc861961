"""Many campaigns on many processes: Dask on this machine by default, on any scheduler by its address."""

from rfea_vision.distributed.batch import BatchResult, run_batch
from rfea_vision.distributed.cluster import Security, dashboard, dask_client

__all__ = ["BatchResult", "Security", "dashboard", "dask_client", "run_batch"]
