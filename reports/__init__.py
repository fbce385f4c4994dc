"""Reports: each script computes with `pvdf_fem` and writes a page; see `reports.thesis`."""
