"""The `greybox` command."""
