"""What runs show: scores, figures, the paper's experiments again."""
