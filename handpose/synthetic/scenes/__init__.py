"""Parts of whole scenes: hands and their people, tables, things, walls; how often each appears."""
