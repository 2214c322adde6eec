"""A station that holds its stick ahead while it runs: `python -m tests.drive.steers PORT`."""

import sys
import time

from cohelm.core.types import CENTRED, Stick
from cohelm.link import keys
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.station_end import StationEnd


def main() -> None:
    with StationEnd(keys.station(), "127.0.0.1", int(sys.argv[1])) as station:
        asked = 0.0
        while True:
            received = station.status()
            told = received and received.message
            ahead = told and told.arming == Arming.ARMED and told.mode == Mode.MANUAL
            station.steer(Command(Stick(0.7, 0.0) if ahead else CENTRED, True, True, Device.SCRIPT))
            if told and time.monotonic() - asked > 0.5:  # an answer may come too late
                asked = time.monotonic()
                lease = told.lease
                if lease.driver != lease.you:
                    station.ask(RequestKind.TAKE, 0)
                elif told.mode != Mode.MANUAL and not told.stopped:
                    station.ask(RequestKind.MODE, Mode.MANUAL)
            time.sleep(0.02)


if __name__ == "__main__":
    main()
