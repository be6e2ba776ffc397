"""``skelsplat app`` (extra ``app``): a page in the browser that fills in commands of `skelsplat.cli`."""
