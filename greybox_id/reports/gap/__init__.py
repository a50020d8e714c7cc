"""What a person sees of a diagnosis: sentences, one page of pictures, a report."""
