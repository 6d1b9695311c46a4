"""Tables, figures, page and videos, from evaluation files only."""
