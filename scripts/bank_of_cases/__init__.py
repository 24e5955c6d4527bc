"""Fixed sets of drawn cases, the answers of programs to them, and scores by which two programs are compared."""
