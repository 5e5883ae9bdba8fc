"""Who may do what at the API and in the windows: roles and their rights, accounts, sessions, tokens, and where they are stored."""
