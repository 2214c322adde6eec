"""Types that every room shares: poses, twists, discs, traces, errors."""
