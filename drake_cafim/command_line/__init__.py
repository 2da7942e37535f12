"""What all commands of `cafim` share: their group and its errors, their options, and where they write."""
