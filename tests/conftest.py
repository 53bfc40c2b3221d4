"""One thread for every test: the suite runs beside others, and small tensors gain nothing."""

import cv2
import torch

torch.set_num_threads(1)
cv2.setNumThreads(1)
