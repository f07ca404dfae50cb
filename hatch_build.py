"""Build hook: a wheel with machine code of the event loop and the methods.

It is an option: ``HATCH_BUILD_HOOK_ENABLE_CUSTOM=true python -m build --wheel``.
"""

import os
import subprocess
import sys
from importlib.metadata import version as version_of

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class PrecompilationHook(BuildHookInterface):
    """Compile what depends on no system, so that the first run does not wait for it."""

    def initialize(self, version, build_data):  # noqa: D102
        command = [sys.executable, "-m", "mems_impact.hybrid.precompilation", "--distribute"]
        paths = os.pathsep.join([self.root, *filter(None, [os.environ.get("PYTHONPATH")])])
        subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=True)
        build_data["artifacts"].append("mems_impact/integrators/jit/precompiled/*.code")
        build_data["pure_python"], build_data["infer_tag"] = False, True
        # Other versions of numba would not find the code.
        build_data["dependencies"].append(f"numba=={version_of('numba')}")
