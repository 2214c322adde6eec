"""The command `cohelm` itself: what happens before and after any of its commands."""

from __future__ import annotations

import errno
import io
import logging
import os
import re
import signal
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
import typer.core

from cohelm import __version__
from cohelm.cli.output import plain, say
from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.interrupts import INTERRUPTS

_MAY_BE_EMPTY = ("lock",)
"""Options of which an empty value means none."""
_MOST_PROBLEMS = 20
"""Of a scenario's problems, no more than these are printed."""


class _Command(typer.core.TyperCommand):
    """Refuses an empty value, as where a variable of the shell is not set: the default instead
    could set off a robot that was given another site, mode or dock. Also one of several lines, as
    of a command's output: what is said of it would be several errors."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        try:
            rest = super().parse_args(ctx, args)
        except _UsageError as error:
            error.ctx = error.ctx or ctx  # an option without its value has none
            raise
        for one in self.params:
            value = ctx.params.get(one.name)
            given = ctx.get_parameter_source(one.name).name != "DEFAULT"
            name = one.opts[0] if one.param_type_name == "option" else one.metavar
            if given and one.name not in _MAY_BE_EMPTY and (value == "" or "" in _several(value)):
                raise CohelmError(
                    f"{name} is empty: name one" + ", or leave it out" * (not one.required)
                )
            if given and isinstance(value, str | Path) and "\n" in str(value):
                raise CohelmError(f"{name} has a line break in it: take that out")
        return rest


def _several(value: object) -> tuple[object, ...]:
    return tuple(value) if isinstance(value, list | tuple) else ()  # pyright: ignore


class CommandLine(typer.Typer):
    """Commands that refuse an empty value."""

    def command(self, name: str | None = None, **options: Any) -> Any:
        """As of typer."""
        return super().command(name, cls=_Command, **options)


def given(context: typer.Context) -> list[str]:
    """The options on the command line, or in its parameter file, as they are typed."""
    command: Any = context.command
    found: list[str] = []
    for one in command.params:
        source: Any = context.get_parameter_source(one.name)
        if one.param_type_name == "option" and source.name != "DEFAULT":
            off = context.params[one.name] is False and one.secondary_opts
            found.append((one.secondary_opts if off else one.opts)[0])
    return found


def idle_beside(context: typer.Context, option: str, *used: str) -> None:
    """Raise CohelmError for other options than those in use beside this one: what is typed and has
    no effect was meant otherwise."""
    idle = [name for name in given(context) if name not in (option, *used)]
    if idle:
        raise CohelmError(f"{_listed(idle)} {_has(idle)} beside {option}: leave one of them out")


def idle_together(context: typer.Context, beside: Iterable[str], *idle: str) -> None:
    """Raise CohelmError for one of these options with which another has no effect."""
    names = given(context)
    for option in beside:
        if option in names:
            idle_beside(context, option, *(name for name in names if name not in idle))


def idle_without(context: typer.Context, option: str, *needed: str) -> None:
    """Raise CohelmError for an option that has an effect only with one of the others."""
    names = given(context)
    if option in names and not any(one in names for one in needed):
        *others, last = needed
        which = f"{', '.join(others)} or {last}" if others else last
        raise CohelmError(f"{option} {_has([option])} without {which}: add that, or leave it out")


def _listed(names: list[str]) -> str:
    return " and ".join(names)


def _has(names: list[str]) -> str:
    return "has no effect" if len(names) == 1 else "have no effect"


app = CommandLine(
    name="cohelm",
    help="Shared control with obstacle avoidance for uncrewed ground vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help is there in a third of the time, and reads as well
    epilog="Start with `cohelm run minimal`, or `cohelm drive`. `cohelm COMMAND --help` tells "
    "more of one.",
)

FAILED = 1
USER_ERROR = 2
INTERRUPTED = 130
_UsageError: Any = typer.BadParameter.__base__  # typer names it in no other way
_NO_NODE = (
    "--ros-args: cohelm is no node of rclpy: name topics with --in, --out, --scan and --odom (of "
    "filter) or --topic (of robot), the namespace with --namespace or --topic namespace=/NAME, and "
    "give a parameter file with --params"
)


@cache
def _built() -> Any:
    """All commands, once in a process: to read their annotations takes longer than to parse a
    line."""
    return typer.main.get_command(app)


def main() -> None:
    """Run the command line: one sentence and code 2 for what the user can mend, 1 where the disk is
    full, 130 on Ctrl-C."""
    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that has no m² shows m?
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # of a home that it can not write to
    patient()
    try:
        try:
            if "--ros-args" in sys.argv:
                raise CohelmError(_NO_NODE)
            if code := _built()(standalone_mode=False):
                sys.exit(code)
        finally:
            if sys.stdout is not None:  # pyright: ignore[reportUnnecessaryComparison]  # `>&-`
                sys.stdout.flush()
    except _UsageError as error:
        _explain(error)
        sys.exit(USER_ERROR)
    except typer.Abort:  # of a question that Ctrl-C answered
        sys.exit(INTERRUPTED)
    except CohelmError as error:
        lines = str(error).splitlines()
        for line in lines[:_MOST_PROBLEMS]:
            say(f"[bold red]error:[/bold red] {plain(line)}")
        if lines[_MOST_PROBLEMS:]:
            say(f"... and {len(lines) - _MOST_PROBLEMS} more")
        sys.exit(FAILED if _of_full_disk(error) else USER_ERROR)
    except OSError as error:
        from cohelm.core.files import NO_NAMES  # its imports would delay each command

        if error.errno in NO_NAMES:
            say(f"[bold red]error:[/bold red] {plain(f'{error.filename} can not be read')} "
                f"({error.strerror}): check the name")  # fmt: skip
            sys.exit(USER_ERROR)
        # Nothing more can be written there, and Python must not try again when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):  # that one is `cohelm ... | head`
            say(f"[bold red]error:[/bold red] {plain(_unusable(error))}")
        sys.exit(FAILED)
    finally:
        settled()
        _say_unkept()


_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _of_full_disk(error: BaseException | None) -> bool:
    """Whether this came of a disk that is full: what was given is right, so it is no error of the
    user's, wherever it was noticed."""
    while error is not None and not (isinstance(error, OSError) and error.errno in _FULL):
        error = error.__cause__ or error.__context__
    return error is not None


def _unusable(error: OSError) -> str:
    """What can not be read or written, and the cure."""
    why = f"({error.strerror})"
    if error.errno in _FULL:
        return f"{error.filename or 'what is printed'} can not be written {why}: free some space"
    if error.filename is not None:
        return f"{error.filename} can not be read or written {why}: choose a place where you may"
    if error.errno == errno.ENOENT:  # of its own only the working folder has no name
        return "the folder that this was started in has been removed: go to another"
    return f"what is printed can not be written {why}: choose a place you may write to"


def _say_unkept() -> None:
    """What is slow at each start has its reason."""
    jit = sys.modules.get("cohelm.core.jit")
    if jit is not None and (why := jit.unkept()):
        say(
            f"[yellow]warning:[/yellow] what was compiled is not kept ({plain(why)}), so every "
            "start takes a minute: give COHELM_CACHE_DIR a folder that you may write to"
        )


def _open_standard_streams() -> None:
    """Where one was closed (`>&-`) a file or socket would take its number, and what is printed."""
    while (opened := os.open(os.devnull, os.O_RDWR)) < 3:
        os.set_inheritable(opened, True)
    os.close(opened)


def examples(*lines: str) -> str:
    """What stands below a command's help: how it is typed, a line each."""
    return "\b\n" + "\n".join(("For example:", *(f"  {line}" for line in lines)))


def _explain(error: Any) -> None:
    """What is wrong with the command line, in a sentence; without any command, the help."""
    text = error.format_message()
    if not error.ctx or text == error.ctx.get_help():
        error.show()
        return
    if "unexpected extra argument" in text and (second := _SECOND.get(error.ctx.info_name)):
        text = f"{text.rstrip('.')}: {second}"
    if meant := _meant(error):
        text = f"{text.partition(' (')[0].rstrip('.')}: here that is {meant}"
    elif known := getattr(error, "possibilities", None):
        text = f"no such option: {error.option_name}{did_you_mean(error.option_name, known)}"
    text = re.sub(r"Input should be (.*?)(, unable to parse .*)?$", r"must be \1", text)
    hint = f"{text.rstrip('.')}; see `{error.ctx.command_path} --help`"
    say(f"[bold red]error:[/bold red] {plain(hint[0].lower() + hint[1:])}")


_TIMES = ("for", "seconds", "duration")
_ENDS = {
    "run": "--set simulation.duration_s=SECONDS",
    "drive": "Ctrl-C, or --for of `cohelm robot`",
}
"""How one has a command end, that has no --for."""
_SECOND = {
    "run": "the folder to write into is --out DIR",
    "map": "the folder to write into is --out DIR",
    "replay": "it takes one record at a time",
    "robot": "where it is driven is --scenario SCENARIO",
    "drive": "where it is driven is --scenario SCENARIO",
    "campaign": "the number of episodes is --n N",
    "station": "the robot to connect to is --robot HOST",
}
"""What a second word may have been, to commands that take one."""


def _meant(error: Any) -> str:
    """How else to say what an option that there is not was to say: a time, or a key of the
    scenario; empty: nobody knows."""
    name = str(getattr(error, "option_name", "")).lstrip("-").replace("-", "_")
    options = {option for one in error.ctx.command.params for option in one.opts}
    if name in _TIMES:
        return "--for SECONDS" if "--for" in options else _ENDS.get(error.ctx.info_name, "")
    if not name or "--set" not in options:
        return ""
    from cohelm.scenario.model import Scenario

    return f"--set {name}=VALUE" if name in Scenario.model_fields else ""


def _version(wanted: bool) -> None:
    if wanted:
        print(f"cohelm {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of every command."""


# Ctrl-C between two steps, never in the middle of one.
#
# numba (0.68) converts results of compiled code to Python objects by calls that it does not expect
# to fail: an interrupt there ends the process with a segmentation fault, and truncates the record.
# So it is delayed by a moment.


_MOMENT = 0.003  # [s]
_LOSES = ("_raw_object_cache", "__del__", "__set_name__")
"""Functions in which an exception is lost, or becomes another, as while a class is made."""
_COMPILER = "/numba/core/compiler_machinery.py"


def patient() -> None:
    """Take Ctrl-C as `KeyboardInterrupt`, as Python does, but not inside numba.

    A process that does not heed Ctrl-C, or has its own way with it, is left as it is.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGALRM, interrupted)
        signal.signal(signal.SIGINT, interrupted)


def end_as_by_ctrl_c() -> None:
    """Take the other `INTERRUPTS` as Ctrl-C too."""
    for number in INTERRUPTS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(signal.SIGALRM, interrupted)
            signal.signal(number, interrupted)


def settled() -> None:
    """The command is over: drop an interrupt that was put off, as nothing could handle it."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def interrupted(_: int, frame: FrameType | None) -> None:
    """The handler: raises, or comes again as an alarm, however often, until it can."""
    if frame is not None and _inside(frame):
        signal.setitimer(signal.ITIMER_REAL, _MOMENT)
        return
    raise KeyboardInterrupt


def _inside(frame: FrameType) -> bool:
    """Whether this code runs while numba makes an answer: its own, that of named tuples, which is
    made from text, or this one's. Its compiler may be interrupted, which is at it for a minute, but
    for what LLVM calls back: see `_LOSES`."""
    file, compiles = frame.f_code.co_filename, False
    above: FrameType | None = frame
    while above is not None:
        if above.f_code.co_name.startswith(_LOSES):
            return True
        compiles = compiles or above.f_code.co_filename.endswith(_COMPILER)
        above = above.f_back
    return not compiles and (file.startswith("<") or "/numba/" in file or file == __file__)
