"""The workbench: from a scenario or a log to a decision about a unit, a filter, a route.

insenv.budget("ship-swaying", "q-method")
"""
