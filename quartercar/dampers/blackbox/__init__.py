"""Dampers that are models of lpvid underneath: LPV-ARX, NARX, quasi-LPV, and what `lpvid identify` wrote."""
