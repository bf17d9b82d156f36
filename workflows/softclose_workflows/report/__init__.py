"""The report of a campaign: `gather` reads a store into `ReportData`, `charts` and `page` draw it as one HTML file."""
