"""Whether the pictures of the gallery look as they did, each beside its reference.

References stand in ``docs/pictures``, a third as wide as the pictures. Antialiasing and layout may
differ a little, so that a pixel may lie anywhere between the darkest and the lightest of those
about it in the other picture, in each colour. What is beyond is a difference: a line, marker,
colour or text that was not there, or is no more. With ``PICTURES=renew`` in the environment
references are written, not compared with.

The root mean square over a picture, by which pytest-mpl and matplotlib.testing compare, is larger
where a text moves by a pixel than where a thin line is missing.
"""

import os
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

REFERENCES = Path(__file__).parent / "pictures"
SINCE = (3, 11)  # matplotlib spaces lines of text in another way before
WIDTH = 340  # px
BLUR = 1.0  # px
ABOUT = 2  # px
MOST = 0.15  # of the range from black to white

# Rounding decides where dots of chaos lie, and how large an error near rounding is: another
# processor draws others.
BY_ROUNDING = {
    "bifurcation_diagram_branch",
    "bouncing_ball_branch", "buck_converter_branch", "impact_oscillator_branch", "lorenz_branch",
    "lorenz_run", "methods_and_accuracy", "operating_map_motions", "operating_map_speed",
    "own_system_branch", "studies", "symmetry_breaking_branch", "two_stop_rattler_branch",
}  # fmt: skip


class PictureError(Exception):
    """A picture does not look as it did."""


def check(path):
    """Compare a picture with its reference, or renew that; PictureError where they differ."""
    if path.stem in BY_ROUNDING or matplotlib.__version_info__ < SINCE:
        return
    made, reference = small(path), REFERENCES / path.name
    if os.environ.get("PICTURES") == "renew":
        # By this method a small marker keeps its colour among 64.
        made.quantize(64, Image.Quantize.FASTOCTREE).save(reference, optimize=True)
        return
    if not reference.exists():
        raise PictureError(f"{path.name} has no reference; PICTURES=renew writes one")
    found, (x, y) = difference(made, Image.open(reference))
    if found > MOST:
        raise PictureError(
            f"{path.name} looks unlike docs/pictures/{path.name}: by {found:.2f}, more than {MOST},"
            f" {x:.0%} from the left and {y:.0%} from the top; PICTURES=renew takes it as meant"
        )


def small(path):
    """Return a picture in the size of references."""
    picture = Image.open(path).convert("RGB")
    height = round(picture.height * WIDTH / picture.width)
    return picture.resize((WIDTH, height), Image.Resampling.BOX)


def difference(one, other):
    """Return the largest difference of two pictures, and its place."""
    if abs(one.height - other.height) > ABOUT:
        return 1.0, (0.0, 1.0)
    a, b = (_smooth(picture.convert("RGB").resize(one.size)) for picture in (one, other))
    beyond = np.maximum(_outside(a, b), _outside(b, a)).max(axis=2)
    y, x = np.unravel_index(beyond.argmax(), beyond.shape)
    return float(beyond[y, x]), (x / one.width, y / one.height)


def _smooth(picture):
    """Return a picture as numbers from 0 to 1, shape (height, width, 3), blurred."""
    return gaussian_filter(np.asarray(picture, dtype=float) / 255.0, (BLUR, BLUR, 0.0))


def _outside(values, others):
    """Return how far values are outside the range of the others about them."""
    size = (2 * ABOUT + 1, 2 * ABOUT + 1, 1)
    low, high = minimum_filter(others, size), maximum_filter(others, size)
    return np.maximum(values - high, low - values).clip(0.0)
