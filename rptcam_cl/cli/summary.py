"""What is said of a render when it has ended."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli.progress import as_duration

if TYPE_CHECKING:
    from rptcam_cl.imaging import Image

MUCH_BLOCKED = 0.1  # of the rays pass at least, or something is wrong


def _metered(metadata: dict[str, Any]) -> str:
    """What exposure ``auto`` has chosen: the light, and time and ISO where there are any."""
    chosen = f"metered {metadata['metered_cd_m2']:.4g} cd/m²"
    if "exposure_time_s" in metadata:
        time_s = metadata["exposure_time_s"]
        chosen += f", {f'1/{1 / time_s:.0f}' if time_s < 0.1 else f'{time_s:.3g}'} s at ISO {metadata['iso']:.4g}"
    return chosen


def samples(stats: dict[str, Any]) -> str:
    """How many samples the pixels have; with a noise target each tile has as many as it takes."""
    spread = stats.get("noise", {"spp_min": stats["spp"]})
    if spread["spp_min"] == stats["spp"]:
        return f"{stats['spp']} spp"
    return f"{spread['spp_mean']:.0f} spp on average ({spread['spp_min']} to {stats['spp']})"


def summary(image: "Image", outputs: list[Path]) -> str:
    """How large the picture is, where it went, how long it took, and what the lens and the meter have done."""
    stats: dict[str, Any] = image.stats
    seconds = stats["seconds"]
    parts = [
        f"{image.width} x {image.height}",
        samples(stats),
        f"{as_duration(seconds['total'])} ({as_duration(seconds['render'])} rendering)",
        f"{stats['msamples_per_second']:.3g} Msamples/s",
    ]
    outcomes = stats.get("lens")
    if outcomes and sum(outcomes.values()):
        parts.append(f"the lens blocked {100 * (1 - outcomes['passed'] / sum(outcomes.values())):.0f} % of the rays")
    if "metered_cd_m2" in image.metadata:
        parts.append(_metered(image.metadata))
    return f"wrote {', '.join(map(str, outputs))}: {', '.join(parts)}"


def blocked_warning(image: "Image") -> list[str]:
    """Return what to say where hardly a ray passes the lens: most of the film is dark then, or noisy."""
    outcomes = image.stats.get("lens")
    if not outcomes or not sum(outcomes.values()) or outcomes["passed"] >= MUCH_BLOCKED * sum(outcomes.values()):
        return []
    share = 1 - outcomes["passed"] / sum(outcomes.values())
    size = image.metadata.get("film_size_mm")
    film = f" of {size[0]:.4g} x {size[1]:.4g} mm" if isinstance(size, list | tuple) and len(size) == 2 else ""
    return [
        f"the lens blocked {100 * share:.0f} % of the rays: the film{film} is perhaps larger than its image circle"
        " (rptcam lens info says how large that is; film.width_mm or film.format sets the film)"
    ]


def shared(stats: dict[str, Any]) -> str | None:
    """What each of several devices has done, and how to have the same again; nothing for a device alone."""
    if len(stats.get("devices", ())) < 2:
        return None
    done = [
        f"{device['id']} {device['name']} "
        + ("was dropped" if "dropped" in device else f"took {device['share']:.1%}")
        + f" at {device['msamples_per_second']:.3g} Msamples/s"
        for device in stats["devices"]
    ]
    again = {part["split"] for part in stats["work"]}
    repeat = f"; --split {again.pop()} repeats it" if len(again) == 1 else ""
    return f"devices: {', '.join(done)}{repeat}"
