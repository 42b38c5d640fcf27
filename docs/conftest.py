"""Pages are collected for their doctests; the site's own scripts and what it generates are not."""

collect_ignore_glob = ["*.py", "building/*", "tutorial/*", "generated/*", "_build/*", "_prepared/*"]
