"""What measured dynamics tell of a switch: its parameters in the device model that a campaign uses, with intervals.

Readings (`readings`) are held against what the model says of them (`model`), by weighted least squares
(`least_squares`); what comes out is a campaign of one's own (`own_campaign`).
"""
