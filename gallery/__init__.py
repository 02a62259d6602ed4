"""The pictures of `docs/gallery`, made anew by `make gallery`."""
