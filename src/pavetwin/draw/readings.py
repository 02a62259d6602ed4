"""The strip below a frame of the animation: the readings of the UAV, what the policy does, and the key."""

from dataclasses import dataclass
from functools import cached_property

from matplotlib.colors import to_hex
from PIL import Image, ImageDraw

from pavetwin.draw import style
from pavetwin.draw.animation_frame import HIDDEN_OPACITY, SEEN_OPACITY, MissionState
from pavetwin.draw.ground_raster import ASPHALT
from pavetwin.draw.mission_marks import DefectOutcome
from pavetwin.draw.mission_style import AGENT_COLOURS, HIDDEN, OPEN_DEFECT, SEEN, font, rgb, visibility_rgb
from pavetwin.draw.shapes import mix
from pavetwin.twin import Mode

HEIGHT_PX = 78
MARGIN_PX = 14

DOING = {
    Mode.GROUND: "on the ground",
    Mode.CLIMB: "climbs",
    Mode.TRANSIT: "flies to the next pass",
    Mode.INSPECT: "inspects",
    Mode.WAIT: "waits for a clear view",
    Mode.DISPLACE: "steps aside",
    Mode.REVISIT: "revisits a hidden place",
    Mode.HOME: "flies home",
    Mode.LAND: "lands",
    Mode.SWAP: "swaps the battery",
    Mode.AVOID: "gives way to an aircraft",
}


@dataclass(frozen=True)
class Readings:
    """Draws the strip; its constant parts are drawn once."""

    width_px: int
    policy: str
    threshold: float
    """τ_o, a tick on the bar of visibility."""

    def draw(self, image: Image.Image, top_px: int, scene: MissionState) -> None:
        """Into `image`, from `top_px` down."""
        pen = ImageDraw.Draw(image)
        image.paste(self._still, (0, top_px))
        minutes, seconds = divmod(round(scene.time_s, 1), 60)
        columns = {
            "time": f"{int(minutes)}:{seconds:04.1f}",
            "speed": f"{scene.uav.speed_mps:.1f} m/s",
            "altitude": f"{scene.uav.altitude_m:.1f} m",
            "battery": f"{100 * scene.uav.battery:.0f} %",
        }
        for number, (name, value) in enumerate(columns.items()):
            self._cell(pen, MARGIN_PX + 96 * number, top_px, name, value)
        x, mode = MARGIN_PX + 96 * len(columns), scene.uav.mode
        self._visibility(pen, x, top_px, scene.visibility)
        self._cell(pen, x + 190, top_px, f"policy {self.policy}", DOING[mode], bold=mode in _REACTIONS)

    @cached_property
    def _still(self) -> Image.Image:
        """The constant parts: background, separator and key."""
        strip = Image.new("RGB", (self.width_px, HEIGHT_PX), style.PAPER)
        pen = ImageDraw.Draw(strip)
        pen.line((0, 0, self.width_px, 0), fill=style.INK_FAINT)
        self._key(pen, 62)
        return strip

    def _cell(self, pen: ImageDraw.ImageDraw, x: int, top: int, name: str, value: str, *, bold: bool = False) -> None:
        pen.text((x, top + 17), name, fill=style.INK_SOFT, font=font(12), anchor="ls")
        pen.text((x, top + 39), value, fill=style.INK, font=font(18, bold=bold), anchor="ls")

    def _visibility(self, pen: ImageDraw.ImageDraw, x: int, top: int, visibility: float | None) -> None:
        value = "–" if visibility is None else f"{visibility:.2f}"
        self._cell(pen, x, top, "visibility o", value)
        left, right, upper, lower = x + 56, x + 166, top + 25, top + 38
        pen.rectangle((left, upper, right, lower), fill=style.SIDEWALK)
        if visibility is not None and visibility > 0:
            reach = left + round((right - left) * visibility)
            pen.rectangle((left, upper, reach, lower), fill=visibility_rgb(visibility))
        tick = left + round((right - left) * self.threshold)
        pen.line((tick, upper - 4, tick, lower + 3), fill=style.INK, width=2)
        pen.text((tick, top + 19), "τ", fill=style.INK, font=font(12), anchor="ms")

    def _key(self, pen: ImageDraw.ImageDraw, y: int) -> None:
        x = MARGIN_PX
        for name in ("car", "van", "truck", "bus", "motorcycle", "parked"):
            pen.rounded_rectangle((x, y - 4, x + 16, y + 4), 2, fill=AGENT_COLOURS[name])
            x = self._word(pen, x + 21, y, name)
        pen.ellipse((x, y - 3, x + 7, y + 4), fill=AGENT_COLOURS["pedestrian"])
        x = self._word(pen, x + 12, y, "person")
        pen.ellipse((x, y - 4, x + 8, y + 4), outline=rgb(OPEN_DEFECT), width=2)
        x = self._word(pen, x + 13, y, "defect")
        for outcome in (DefectOutcome.CONFIRMED, DefectOutcome.RECOVERED):
            pen.ellipse((x, y - 4, x + 8, y + 4), fill=style.OUTCOME_COLOURS[outcome])
            x = self._word(pen, x + 13, y, outcome.value)
        for colour, opacity, word in ((SEEN, SEEN_OPACITY, "seen"), (HIDDEN, HIDDEN_OPACITY, "hidden")):
            pen.rectangle((x, y - 5, x + 14, y + 4), fill=to_hex(mix(ASPHALT, colour, opacity / 255)))
            x = self._word(pen, x + 19, y, word)

    def _word(self, pen: ImageDraw.ImageDraw, x: int, y: int, word: str) -> int:
        face = font(12)
        pen.text((x, y), word, fill=style.INK, font=face, anchor="lm")
        return round(x + face.getlength(word)) + 13


_REACTIONS = (Mode.WAIT, Mode.DISPLACE, Mode.REVISIT)
