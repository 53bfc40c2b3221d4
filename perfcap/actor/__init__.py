"""What moves: motion, skeleton, skinning, actor."""
