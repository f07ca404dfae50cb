"""Build hook: machine code of the event loop and the methods, in wheels and editable installs."""

import os
import subprocess
import sys

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class PrecompilationHook(BuildHookInterface):
    """Compile what depends on no system, so that the first run does not wait for it.

    Without it, for example if numba cannot be installed for the build, the first run compiles.
    """

    def initialize(self, version, build_data):  # noqa: D102
        command = [sys.executable, "-m", "mems_impact.hybrid.precompilation"]
        if version != "editable":
            command.append("--distribute")  # the wheel may be installed on another processor
        paths = os.pathsep.join([self.root, *filter(None, [os.environ.get("PYTHONPATH")])])
        try:
            subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=True)
        except subprocess.CalledProcessError as error:
            self.app.display_warning(f"the first run will compile the event loop: {error}")
            return
        build_data["artifacts"].append("mems_impact/integrators/jit/precompiled/*.code")
        build_data["pure_python"], build_data["infer_tag"] = False, True
