"""The model itself, independent of any engine: closed forms, rules and components."""
