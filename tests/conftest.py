"""Settings of all tests."""

from hypothesis import HealthCheck, settings

# Drawing is slow on a busy machine, which is no fault of a test.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
