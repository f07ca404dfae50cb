"""What Windows lacks, hidden from a Python process that has this folder on its path.

The package sees `os` and `signal` without what is of Unix, files without a stated encoding are in
code page 1252, open files are neither replaced nor removed, and processes are spawned.
"""

import builtins
import io
import multiprocessing
import os
import shutil
import signal
import subprocess
import types

CODE_PAGE = "cp1252"
ABSENT = {
    "os": {
        "chown", "fchmod", "fork", "forkpty", "getuid", "geteuid", "getgid", "getloadavg",
        "getpgid", "killpg", "mkfifo", "nice", "pread", "pwrite", "sched_getaffinity",
        "setpriority", "setsid", "statvfs", "sysconf", "uname", "wait",
    },
    "signal": {
        "SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2",
        "alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "siginterrupt",
        "sigpending", "sigwait",
    },
}  # fmt: skip
UNIX = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"}  # modules


class WithoutUnix(types.ModuleType):
    """A module less the names that it does not have on Windows."""

    def __getattr__(self, name):
        if name in ABSENT[self.__name__]:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} on Windows")
        return getattr(MODULES[self.__name__], name)


MODULES = {"os": os, "signal": signal}
HIDDEN = {name: WithoutUnix(name) for name in MODULES}
import_module, open_file, start = builtins.__import__, io.open, subprocess.Popen.__init__


def imported(name, namespace=None, *others, **named):
    """Import what Windows has, where the package asks."""
    asks = str((namespace or {}).get("__name__", "")).partition(".")[0]
    if asks == "mems_impact" and name in UNIX:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    module = import_module(name, namespace, *others, **named)
    return HIDDEN.get(module.__name__, module) if asks == "mems_impact" else module


def opened(file, mode="r", buffering=-1, encoding=None, *others, **named):
    """Open a file; a text without an encoding is in the code page."""
    if "b" not in mode and encoding in (None, "locale"):
        encoding = CODE_PAGE
    if isinstance(file, str | os.PathLike) and set(os.path.basename(file)) & set('<>:"|?*'):
        raise OSError(22, "Invalid argument", os.fspath(file))
    if isinstance(file, str | os.PathLike) and os.path.isdir(file) and "opener" not in named:
        raise PermissionError(13, "Permission denied", os.fspath(file))
    return open_file(file, mode, buffering, encoding, *others, **named)


def closed_only(change):
    """Refuse a change of a file that this process has open."""

    def changed(*paths, **named):
        for path in (path for path in paths if isinstance(path, str | bytes | os.PathLike)):
            real = os.path.realpath(os.fsdecode(path))
            for number in os.listdir("/proc/self/fd"):
                try:
                    link = os.readlink(f"/proc/self/fd/{number}")
                except OSError:
                    continue
                if link == real:
                    raise PermissionError(13, "The process cannot access the file", real)
        return change(*paths, **named)

    return changed


def started(self, *arguments, **named):
    """Start a process whose text is in the code page."""
    texts = named.get("text") or named.get("universal_newlines")
    if texts and not named.get("encoding"):
        named["encoding"] = CODE_PAGE
    start(self, *arguments, **named)


builtins.__import__ = imported
builtins.open = io.open = opened
subprocess.Popen.__init__ = started
for name in ("replace", "rename", "remove", "unlink"):
    setattr(os, name, closed_only(getattr(os, name)))
shutil._use_fd_functions = False  # Windows has no paths relative to an open folder
spawn = multiprocessing.context._concrete_contexts["spawn"]
multiprocessing.context._concrete_contexts = {"spawn": spawn}
multiprocessing.context._default_context._default_context = spawn
multiprocessing.get_all_start_methods = lambda: ["spawn"]
