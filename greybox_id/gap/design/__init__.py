"""Design of manoeuvres: what to drive so that parameters become precise, or explanations distinguishable."""
