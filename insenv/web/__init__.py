"""Pages that simulate in a browser: the model as WebAssembly, what starts it, and the document that a page embeds."""
