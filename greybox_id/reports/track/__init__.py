"""What tracking finds: pictures, a file and a report."""
