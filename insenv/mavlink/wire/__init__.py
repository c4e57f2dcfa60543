"""The wire: links, peers, frames, signing."""
