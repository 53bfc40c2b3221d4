"""Images and a posed model to silhouettes, contours and correspondences."""
