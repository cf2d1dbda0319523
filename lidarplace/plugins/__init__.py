"""Packages that lidarplace brings as any other package could: nothing of ours imports them."""
