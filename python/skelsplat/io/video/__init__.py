"""Videos and folders of images: which is whose camera's, frames in, frames out, one in memory at a time."""

from skelsplat.io.video._find import find_videos
from skelsplat.io.video._source import FrameSource, Image, Size, open_source
from skelsplat.io.video._write import Mp4Sink, PngSink

__all__ = ["FrameSource", "Image", "Mp4Sink", "PngSink", "Size", "find_videos", "open_source"]
