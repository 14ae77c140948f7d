"""One file a row of the matrix in docs/reliability.md: TITLE, PASS, and run(proof)."""
