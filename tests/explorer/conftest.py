import os
import shutil
import signal
import subprocess
import sys

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
LONG = 300.0  # s in which a page is to be there, on a machine that has other work


class Served:
    """The command, running."""

    def __init__(self, folder, *arguments):
        command = [sys.executable, "-u", "-m", "mems_impact", "explore", *arguments]
        self.process = subprocess.Popen(
            [*command, "--port", "0", "--no-browser"],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            # A shell has what it puts into the background ignore Ctrl-C.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )  # fmt: skip
        line = self.process.stdout.readline()
        assert "http://127.0.0.1:" in line, self.process.stderr.read()
        self.address = next(word for word in line.split() if word.startswith("http"))

    def end(self, number=signal.SIGINT):
        """End it as Ctrl-C does; return status and what it said on standard error."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        _, said = self.process.communicate(timeout=LONG)
        return self.process.returncode, said


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """Serve something; all that is served ends with the tests."""
    running = []

    def serve(*arguments, folder=None):
        running.append(Served(folder or tmp_path_factory.mktemp("served"), *arguments))
        return running[-1]

    yield serve
    for each in running:
        each.end()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """A real browser without a window, whose downloads go to ``browser.folder``."""
    if not (CHROMIUM and DRIVER):
        pytest.skip("no chromium with its driver on this machine (Debian: chromium-driver)")
    from selenium import webdriver

    folder = tmp_path_factory.mktemp("downloads")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    # Without its sandbox, which the system user cannot have.
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage",
                     "force-prefers-reduced-motion"):  # fmt: skip
        options.add_argument(f"--{argument}")
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_window_size(1280, 1000)
    driver.set_script_timeout(LONG)
    driver.folder = folder
    yield driver
    driver.quit()
