"""The words every room shares: poses, twists, discs, traces, errors."""
