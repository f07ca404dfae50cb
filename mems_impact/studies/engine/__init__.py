"""The engine of studies, independent of their kinds: scheduling, executors, stores."""
