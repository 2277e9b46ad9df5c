"""Pictures, figures and recordings of what packmech made."""
