"""Floor 3: truth is read here: errors, closures, figures, reports."""
