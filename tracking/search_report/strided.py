"""How values of the search differ from exact ones: it may fire fewer rays."""

from __future__ import annotations

from tracking.run_folders.search_json import SearchResult


def strided(search: SearchResult) -> str:
    """Which rays the search fired, as words; "" if it fired all, or none at all."""
    if search.stride is None or search.stride.azimuth_stride <= 1:
        return ""
    return f"rays of 1 in {search.stride.azimuth_stride} azimuth steps"
