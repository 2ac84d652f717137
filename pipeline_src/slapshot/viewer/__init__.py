"""Hits as Rerun recordings, and a gallery to browse them. The only package that needs rerun-sdk."""
