"""The engine of studies: scheduling, executors, stores. It knows no kind of study."""
