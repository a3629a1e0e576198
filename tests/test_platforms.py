"""Windows and macOS by construction: calls that not every system has, texts, file names and starts of processes."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import dynident

SOURCE = Path(dynident.__file__).parent
ROOT = Path(__file__).parent.parent

#: Attributes that Windows or macOS lack, by module (Python 3.14, library reference: "Availability").
MISSING = {
    "os": set(
        "fork forkpty kill killpg getpgid getpgrp setpgid setsid getsid getuid geteuid getgid getegid getgroups setuid "
        "seteuid setgid setgroups chown fchown lchown fchmod chroot uname nice getpriority setpriority mkfifo mknod "
        "getloadavg sched_getaffinity sched_setaffinity sched_yield posix_spawn posix_spawnp posix_fadvise "
        "posix_fallocate pipe2 wait wait3 wait4 waitid WNOHANG WEXITSTATUS WIFSIGNALED WTERMSIG O_CLOEXEC O_NOFOLLOW "
        "O_DIRECTORY O_NONBLOCK sync sendfile statvfs fstatvfs pread pwrite preadv pwritev openpty memfd_create "
        "pidfd_open confstr sysconf getxattr setxattr listxattr copy_file_range ctermid tcgetpgrp".split()
    ),
    "signal": set(
        "SIGKILL SIGSTOP SIGCONT SIGHUP SIGQUIT SIGALRM SIGPROF SIGVTALRM SIGUSR1 SIGUSR2 SIGPIPE SIGCHLD SIGXCPU "
        "SIGTSTP SIG_BLOCK SIG_UNBLOCK SIG_SETMASK ITIMER_PROF ITIMER_REAL ITIMER_VIRTUAL setitimer getitimer alarm "
        "pause pthread_sigmask pthread_kill sigwait sigwaitinfo sigtimedwait sigpending siginterrupt".split()
    ),
    "socket": set("AF_UNIX SO_REUSEPORT send_fds recv_fds".split()),
    "time": set("tzset clock_gettime clock_settime CLOCK_MONOTONIC CLOCK_PROCESS_CPUTIME_ID".split()),
    "mmap": set("MAP_ANONYMOUS MAP_PRIVATE MAP_SHARED PROT_READ PROT_WRITE MADV_DONTNEED".split()),
}

#: Modules that Windows lacks.
MODULES = set(
    "fcntl grp posix pty pwd resource spwd syslog termios tty crypt nis multiprocessing.resource_tracker".split()
)

#: Calls that stand unguarded for a reason.
REASONS = {
    ("studio/child.py", "os.kill"): "Windows has os.kill, which ends a process by TerminateProcess",
    **{
        ("workers/processes.py", name): "Processes refuses a limit of the processor time where there is no such clock"
        for name in ("signal.SIGPROF", "signal.setitimer", "signal.ITIMER_PROF")
    },
}

#: Names that Windows keeps for devices, with any ending.
DEVICES = {"con", "prn", "aux", "nul", *(f"{kind}{k}" for kind in ("com", "lpt") for k in range(1, 10))}


def _asks_the_system(node: ast.AST) -> bool:
    """Whether an expression asks if the system has something."""
    words = {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}
    calls = {part.func.id for part in ast.walk(node) if isinstance(part, ast.Call) and isinstance(part.func, ast.Name)}
    return bool({"hasattr", "getattr"} & calls or {"name", "platform"} & words)


def _catches(node: ast.Try) -> bool:
    names = {
        part.id
        for handler in node.handlers
        if handler.type
        for part in ast.walk(handler.type)
        if isinstance(part, ast.Name)
    }
    return bool({"ImportError", "ModuleNotFoundError", "AttributeError"} & names)


def _leaves(node: ast.stmt) -> bool:
    """Whether a statement leaves the function where the system lacks something."""
    return (
        isinstance(node, ast.If) and _asks_the_system(node.test) and isinstance(node.body[-1], ast.Return | ast.Raise)
    )


def _unguarded(node: ast.AST, guarded: bool = False) -> Iterator[tuple[str, int]]:
    """Yield each use of what a system may lack with its line, but those that ask for it before."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        module = node.module if isinstance(node, ast.ImportFrom) else None
        names = [f"{module}.{alias.name}" if module else alias.name for alias in node.names]
        if not guarded:
            yield from ((name, node.lineno) for name in [*names, module or ""] if name in MODULES)
        if not guarded and module in MISSING:
            yield from ((f"{module}.{a.name}", node.lineno) for a in node.names if a.name in MISSING[module])
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and not guarded:
        if node.attr in MISSING.get(node.value.id, ()):
            yield f"{node.value.id}.{node.attr}", node.lineno
    if isinstance(node, ast.keyword) and node.arg in ("preexec_fn", "pass_fds") and not guarded:
        yield node.arg, node.value.lineno
    here = guarded or (isinstance(node, ast.If | ast.IfExp | ast.BoolOp) and _asks_the_system(node))
    here = here or (isinstance(node, ast.Try) and _catches(node))
    if isinstance(node, ast.If) and not guarded:  # what stands within is no question
        here = _asks_the_system(node.test)
    for child in ast.iter_child_nodes(node):
        yield from _unguarded(child, here)
        if isinstance(node, ast.FunctionDef) and isinstance(child, ast.If) and _leaves(child):
            here = True


def _mode(call: ast.Call, place: int) -> str:
    given = [word.value for word in call.keywords if word.arg == "mode"] or call.args[place : place + 1]
    return given[0].value if given and isinstance(given[0], ast.Constant) and isinstance(given[0].value, str) else "r"


def _careless_texts(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield files opened as text without an encoding, or written without saying what a line ends with."""
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        words = {word.arg for word in call.keywords}
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        plain = isinstance(call.func, ast.Name)
        if name in ("read_text", "write_text") and not (
            words & {"encoding"} or len(call.args) > (name == "write_text")
        ):
            yield f"{name} without encoding", call.lineno
        if name == "write_text" and "newline" not in words:
            yield "write_text without newline", call.lineno
        if name == "fdopen" or (name == "open" and (plain or words & {"mode", "encoding", "newline", "errors"})):
            mode = _mode(call, 1 if plain or name == "fdopen" else 0)
            if "b" not in mode and "encoding" not in words:
                yield f"open of text ('{mode}') without encoding", call.lineno
            if "b" not in mode and set(mode) & set("wax+") and "newline" not in words:
                yield f"open of text ('{mode}') without newline", call.lineno


def _processes(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield starts of Python processes whose method is that of the system, which differs between systems."""
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        said = ast.unparse(call.func)
        words = {word.arg for word in call.keywords}
        if said.endswith("get_context") and [ast.unparse(a) for a in call.args] not in (["'spawn'"], ["'forkserver'"]):
            yield "get_context of another method than spawn", call.lineno
        if said in (
            "multiprocessing.Process",
            "multiprocessing.Pool",
            "multiprocessing.Queue",
            "multiprocessing.Manager",
        ):
            yield said, call.lineno
        if said.endswith("ProcessPoolExecutor") and "mp_context" not in words:
            yield "ProcessPoolExecutor without mp_context", call.lineno


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*.py") if "__pycache__" not in file.parts)


def _told(check, folder: Path) -> list[str]:  # type: ignore[no-untyped-def]
    found = []
    for file in _files(folder):
        place = file.relative_to(folder).as_posix()
        tree = ast.parse(file.read_text(encoding="utf-8"))
        found += [f"{place}:{line}: {what}" for what, line in check(tree) if (place, what) not in REASONS]
    return found


def test_what_a_system_may_lack_is_asked_for_before_it_is_used() -> None:
    assert _told(_unguarded, SOURCE) == []


def test_text_files_say_their_encoding_and_their_line_ends() -> None:
    assert _told(_careless_texts, SOURCE) == []


@pytest.mark.parametrize("folder", ["src/dynident", "tests", "benchmarks"])
def test_python_processes_start_the_same_way_on_every_system(folder: str) -> None:
    assert _told(_processes, ROOT / folder) == []


BAD = {
    _unguarded: [
        "os.killpg(1, 9)",
        "import fcntl",
        "from os import fork",
        "if True:\n    signal.SIGKILL",
        "def f():\n    if hasattr(os, 'fork'):\n        pass\n    os.fork()",
        "run(preexec_fn=f)",
    ],
    _careless_texts: [
        "open('a')",
        "open('a', 'w', encoding='utf-8')",
        "path.read_text()",
        "path.write_text('a', encoding='utf-8')",
        "path.open(mode='a', encoding='utf-8')",
    ],
    _processes: ["multiprocessing.get_context('fork')", "multiprocessing.Pool(2)", "ProcessPoolExecutor(2)"],
}
GOOD = {
    _unguarded: [
        "if hasattr(os, 'killpg'):\n    os.killpg(1, 9)",
        "a = os.nice(1) if os.name == 'posix' else 0",
        "try:\n    import fcntl\nexcept ImportError:\n    pass",
        "def f():\n    if not hasattr(os, 'fork'):\n        return\n    os.fork()",
        "getattr(signal, 'SIGKILL', 15)",
        "os.replace(a, b)",
    ],
    _careless_texts: [
        "open('a', 'rb')",
        "open('a', encoding='utf-8')",
        "open('a', 'w', encoding='utf-8', newline='')",
        "archive.open(member)",
        "path.write_text('a', encoding='utf-8', newline='')",
    ],
    _processes: ["multiprocessing.get_context('spawn')", "ProcessPoolExecutor(2, mp_context=own)"],
}


def test_each_rule_finds_what_it_forbids_and_nothing_else() -> None:
    for check, lines in BAD.items():
        assert [line for line in lines if not list(check(ast.parse(line)))] == []
    for check, lines in GOOD.items():
        assert [line for line in lines if list(check(ast.parse(line)))] == []


def test_file_names_differ_by_more_than_case_and_every_system_takes_them() -> None:
    bad, seen = [], {}
    for folder in ("src", "tests", "docs", "examples", "benchmarks", "scripts", "fuzz", "constraints"):
        for path in (ROOT / folder).rglob("*"):
            place = path.relative_to(ROOT).as_posix()
            if "__pycache__" in place:
                continue
            if seen.setdefault(place.casefold(), place) != place:
                bad.append(f"{place} beside {seen[place.casefold()]}")
            if set(path.name) & set('<>:"|?*\\') or path.name[-1] in " ." or path.name.split(".")[0].lower() in DEVICES:
                bad.append(place)
    assert len(seen) > 1000
    assert bad == []
