"""Several devices for one render: which ones are meant, and what share of the work each is to have."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.choose import ALL, choose_device, listed, several_of_environment
from rptcam_cl.device.devices import DeviceInfo, list_devices, problem_of
from rptcam_cl.device.opencl import instead
from rptcam_cl.device.session import Session, open_session

Split = str | Mapping[str, float]
Wanted = str | Session | Sequence[str | Session] | None

ROUNDING = 0.005  # that the sum of the shares may be off by, as that of 0.333, 0.333 and 0.333
EXAMPLE = "--split 0:0=0.7,1:0=0.3"


def open_sessions(wanted: Wanted = None, split: Split | None = None) -> tuple[list[Session], list[float] | None]:
    """Return the sessions of the devices that are to share a render, and their shares where they are given.

    Parameters
    ----------
    wanted
        One device or several, each as `choose_device` takes it or as a session; ``"all"`` is every device that builds
        a kernel. None: those that ``split`` names, else what the environment says.
    split
        Shares by device, which add up to 1: a mapping, or text as ``0:0=0.7,1:0=0.3``.

    Raises
    ------
    DeviceError
        A device that is unknown, unusable or named twice, or shares that are not those of the devices.
    """
    shares = None if split is None else _shares(split)
    if wanted is None and shares is not None:
        wanted = list(shares)
    sessions = _opened(wanted)
    seen: set[str] = set()
    for session in sessions:
        if session.info.id in seen:
            raise DeviceError(f"--device: {session.info.id} {session.info.name} twice (name each device once)")
        seen.add(session.info.id)
    return sessions, None if shares is None else _in_order(shares, sessions)


def means_all(wanted: Wanted) -> bool:
    """Return whether `all` devices were requested rather than named ones; one that cannot begin is then left out."""
    if wanted is None:
        return several_of_environment() == [ALL]
    return not isinstance(wanted, Session) and ALL in ([wanted] if isinstance(wanted, str) else wanted)


def means_one(wanted: str | None, split: Split | None = None) -> bool:
    """Return whether a single device is meant, whichever it is."""
    if wanted is None:
        return split is None and several_of_environment() is None
    return listed(wanted) == [wanted.strip()] and wanted.strip() != ALL


def _opened(wanted: Wanted) -> list[Session]:
    if isinstance(wanted, Session):
        return [wanted]
    if wanted is None:
        wanted = several_of_environment()
        if wanted is None:
            return [open_session(None)]
    entries = [wanted] if isinstance(wanted, str) else list(wanted)
    if not entries:
        raise DeviceError("--device: no device is named (allowed: one or more, or none to have one chosen)")
    words: list[str | Session] = []
    for entry in entries:
        words += listed(entry) if isinstance(entry, str) else [entry]
    if ALL in words:
        if len(words) > 1:
            raise DeviceError("--device: 'all' stands alone (or name the devices)")
        return [open_session(info.id) for info in usable_devices()]
    return [word if isinstance(word, Session) else open_session(word) for word in words]


def usable_devices() -> list[DeviceInfo]:
    """Return every device that builds a kernel, with a warning for each that does not.

    Raises
    ------
    DeviceError
        When none does.
    """
    found, reasons = [], []
    for info in list_devices():
        problem = problem_of(info)
        if problem is None:
            found.append(info)
        else:
            reasons.append(f"device {info.id} {info.name} cannot be used: {problem}")
    if not found:
        raise DeviceError(f"{'; '.join(reasons)}; {instead()}")
    for reason in reasons:
        warnings.warn(f"{reason}; it is left out", UserWarning, stacklevel=2)
    return found


def _shares(split: Split) -> dict[str, float]:
    """Return the shares by the names that were given, in their order."""
    if isinstance(split, str):
        pairs = [part.rpartition("=") for part in split.split(",")]
        given = [(name.strip(), share.strip()) for name, _, share in pairs]
    else:
        given = [(str(name).strip(), str(share)) for name, share in split.items()]
    found: dict[str, float] = {}
    for name, text in given:
        share = float(text) if re.fullmatch(r"[0-9.]*[0-9][0-9.]*(e-?\d+)?", text) and text.count(".") < 2 else math.nan
        if not name or not 0 < share <= 1:
            what = f"{name}={text}" if name else text
            raise DeviceError(f"--split: got {what}; allowed a device and its share, above 0 and up to 1, as {EXAMPLE}")
        if name in found:
            raise DeviceError(f"--split: {name} twice (give each device one share)")
        found[name] = share
    total = math.fsum(found.values())
    if abs(total - 1) > ROUNDING:
        raise DeviceError(f"--split: the shares add up to {total:g} (allowed: 1, as {EXAMPLE})")
    return found


def _in_order(shares: Mapping[str, float], sessions: Sequence[Session]) -> list[float]:
    """Return the shares in the order of the sessions."""
    by_id: dict[str, float] = {}
    for name, share in shares.items():
        identity = name if any(session.info.id == name for session in sessions) else choose_device(name).id
        if identity in by_id:
            raise DeviceError(f"--split: {name} is {identity}, which has a share already (give each device one share)")
        by_id[identity] = share
    chosen = [session.info.id for session in sessions]
    if strangers := [identity for identity in by_id if identity not in chosen]:
        raise DeviceError(
            f"--split: {', '.join(strangers)} is not among the devices of this render, {', '.join(chosen)}"
            " (name the same devices in --device, or leave --device out)"
        )
    if missing := [identity for identity in chosen if identity not in by_id]:
        raise DeviceError(f"--split: no share for device {', '.join(missing)} (give every device one, as {EXAMPLE})")
    return [by_id[identity] for identity in chosen]
