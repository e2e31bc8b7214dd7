"""Quality Control: from what motion has shown to checks, one verdict, and the report on a session. Pure."""
