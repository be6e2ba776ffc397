"""Videos and folders of images: which is whose camera's, frames in, frames out, one in memory at a time."""

from skelsplat.io.video._find import find_videos
from skelsplat.io.video._frames import FrameSource, Image, Size, open_sink, open_source

__all__ = ["FrameSource", "Image", "Size", "find_videos", "open_sink", "open_source"]
