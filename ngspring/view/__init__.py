"""What a person looks at: figures, films, ParaView files, the HTML report."""
