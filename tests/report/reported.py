"""What the capture that reports are tested on has."""

FRAMES = 12
SIZE = (96, 128)  # height and width, px
START = 3  # number of the first frame in the videos
VIEWS = ("left <1>", "right & 2")
