"""Programs that write the tables and plots of results in the README and in the pages of docs."""
