"""Collection, the store on disk, splits."""
