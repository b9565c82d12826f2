"""What is true whatever runs it: closed forms, rules and components. No clock, no engine."""
