"""A picture of what a browser shows."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import viser

PATIENCE_S = 120.0
"""A browser without a GPU draws slowly; one that has gone draws nothing."""


def send_picture(client: viser.ClientHandle) -> None:
    """Let a browser draw its scene as it stands there, and save it as a PNG file.

    Raises:
        ValueError: it does not answer.
    """
    import imageio.v3 as iio

    try:
        pixels = client.get_render(
            client.camera.image_height,
            client.camera.image_width,
            transport_format="png",
            timeout=PATIENCE_S,
        ).astype(np.float64)
    except (TimeoutError, RuntimeError) as error:
        raise ValueError(f"no picture came from the browser: {error}") from None
    opacity = pixels[..., 3:] / 255
    on_white = (opacity * pixels[..., :3] + (1 - opacity) * 255).round().astype(np.uint8)
    file = io.BytesIO()
    iio.imwrite(file, on_white, extension=".png")
    client.send_file_download("studio.png", file.getvalue(), save_immediately=True)
