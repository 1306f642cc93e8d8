"""The next motion: which one tells most about what is asked, and how well it will tell."""
