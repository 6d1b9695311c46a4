"""The whole line as resumable stages: collect, train, evaluate, report."""
