"""What several tests share, and commands that record their data. Nothing here stands for a part that is tested."""
