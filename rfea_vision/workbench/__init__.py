"""The workbench: a local page on which a campaign is set up, played with, fitted and improved.

The server is thin. It reads the campaign's files, hands commands to a process of its own (`worker`), and runs the
compiled model in this one (`play`), so that a slider is answered while a fit is busy elsewhere.
"""
