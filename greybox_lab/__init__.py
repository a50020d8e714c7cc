"""What proves, drives, or runs many: examinations, papers' tables, virtual cars, fleets, driving."""
