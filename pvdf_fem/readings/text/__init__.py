"""Tables in text: lines, separators, headers, and numbers as people and programs write them."""
