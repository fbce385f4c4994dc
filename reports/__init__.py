"""Reports: each computes with `pvdf_fem` and writes a page; the first one is `reports/thesis/`."""
