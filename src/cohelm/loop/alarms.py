"""Alarms, latched until their cause has gone and somebody has acknowledged them."""

from __future__ import annotations

from cohelm.link.messages import Alarm, AlarmKind, Severity

_MOST = 65535  # the number has two bytes on the link


class ActiveAlarms:
    """Alarms by name; the same one raised again has a new number."""

    def __init__(self) -> None:
        self._all: dict[str, Alarm] = {}
        self._number = 0
        self._trouble: dict[str, str] = {}

    def on(
        self, name: str, text: str, severity: Severity = Severity.ALARM,
        kind: AlarmKind = AlarmKind.OTHER,
    ) -> bool:  # fmt: skip
        """Raise an alarm; returns whether it is new."""
        old = self._all.get(name)
        if old is not None and old.active:
            return False
        self._number = self._number % _MOST + 1
        self._all[name] = Alarm(self._number, severity, True, False, text, kind)
        return True

    def reword(self, name: str, text: str) -> None:
        """Change the text of an active alarm; it keeps its number."""
        old = self._all.get(name)
        if old is not None and old.active and old.text != text:
            self._all[name] = old._replace(text=text)

    def off(self, name: str) -> None:
        """Its cause has gone: clear it, or keep it until it is acknowledged."""
        old = self._all.get(name)
        if old is None or not old.active:
            return
        if old.acknowledged:
            del self._all[name]
        else:
            self._all[name] = old._replace(active=False)

    def over_already(self, name: str, text: str) -> None:
        """A warning of what has happened: inactive at once, but to be acknowledged."""
        self.on(name, text, Severity.WARNING)
        self.off(name)

    def trouble(self, name: str, text: str) -> str:
        """Set the present trouble, empty: none; a change raises a new alarm. Returns the previous
        one."""
        before = self._trouble.get(name, "")
        if text != before:
            self._trouble[name] = text
            self.off(name)
            if text:
                self.on(name, text)
        return before

    def over(self, name: str) -> None:
        """Clear the alarm and forget the trouble, so that the same one is raised again."""
        self._trouble.pop(name, "")
        self.off(name)

    def acknowledge(self, number: int) -> bool:
        """Acknowledge alarm `number`, or all (0); returns whether there was any."""
        seen = [name for name, a in self._all.items() if number in (0, a.number)]
        for name in seen:
            alarm = self._all[name]._replace(acknowledged=True)
            if alarm.active:
                self._all[name] = alarm
            else:
                del self._all[name]
        return bool(seen)

    def worst(self) -> tuple[Alarm, ...]:
        """The worst first, the newest of equals first."""
        if not self._all:
            return ()
        return tuple(sorted(self._all.values(), key=lambda a: (-a.severity, -a.number)))
