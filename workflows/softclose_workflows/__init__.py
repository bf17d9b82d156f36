"""Joins the science and the store: campaigns on Dask, the command line, the reports."""
