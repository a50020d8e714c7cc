"""What proves the library, drives with it, or shows it: built on `greybox_id`, never imported by it."""
