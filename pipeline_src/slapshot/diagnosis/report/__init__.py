"""Report of a diagnosis of joints and bodies: text, figures, a Rerun recording."""
