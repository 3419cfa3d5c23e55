"""What can be seen from where, decided once: bakes, what they answer, and how well."""
