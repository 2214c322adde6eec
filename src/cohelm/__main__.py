"""`cohelm`, and `python -m cohelm`: the command, from its first moment.

Importing takes a moment, in which Ctrl-C has nothing to tidy up: the process just ends, by the
signal and without a traceback. From then on `cohelm.cli` handles it.
"""

import signal

_BEFORE = signal.getsignal(signal.SIGINT)
if _BEFORE is signal.default_int_handler:  # not where it is ignored, as in the background
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def main() -> None:
    """Run the command line."""
    from cohelm.cli import main as run

    try:
        if _BEFORE is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:  # just before or after the command itself, which handles its own
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
