"""Files that ship with the package; `skelsplat.io.sample` reads them."""
