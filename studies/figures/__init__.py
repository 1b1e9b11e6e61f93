"""Drawings and figures of merit that studies alone use."""
