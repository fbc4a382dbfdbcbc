"""Computes the outputs of TFLite for the inputs of the test vectors.

pip install ai-edge-litert numpy pillow
pirouette demo -o demo
python make.py MODELS demo/scan/000.jpg demo/scan/003.jpg   also makes the inputs a.png, b.png from photos
python make.py MODELS                                       outputs only

MODELS is a folder with pose_landmark_{lite,full,heavy}.tflite. Writes lite.txt, full.txt and heavy.txt. Each line has the
name of an input, what follows, and the values:
  landmarks      39 times x, y, z in px of the network, visibility and presence before the logistic function
  presence       of a person in the region
  mask_every_16  every 16th column and row of the mask, before the logistic function
  heat_every_16  every 16th column and row of the 39 heat maps, before the logistic function
  positions      33 times x, y in px of the network, refined by the heat maps like MediaPipe's
                 RefineLandmarksFromHeatmapCalculator, here in double precision
"""

import sys
from pathlib import Path

import numpy as np
from ai_edge_litert.interpreter import Interpreter
from PIL import Image

SIDE = 256
NAMES = ["a", "b"]


def make_input(photo, target):
    """Shrinks a photo to a square with black borders; fewer levels make the file small."""
    image = Image.open(photo).convert("RGB")
    image.thumbnail((SIDE, SIDE), Image.Resampling.BOX)
    square = Image.new("RGB", (SIDE, SIDE))
    square.paste(image, ((SIDE - image.width) // 2, (SIDE - image.height) // 2))
    levels = (np.asarray(square) // 12 * 12).astype(np.uint8)
    Image.fromarray(levels).save(target, optimize=True)


def outputs(model, image):
    interpreter = Interpreter(model_path=str(model), num_threads=1)
    interpreter.allocate_tensors()
    tensor = np.asarray(Image.open(image).convert("RGB"), dtype=np.float32) / np.float32(255)
    interpreter.set_tensor(interpreter.get_input_details()[0]["index"], tensor[None])
    interpreter.invoke()
    by_shape = {}
    for detail in interpreter.get_output_details():
        by_shape[tuple(detail["shape"])] = interpreter.get_tensor(detail["index"])[0]
    landmarks, heat = by_shape[1, 195], by_shape[1, 64, 64, 39]
    return {
        "landmarks": landmarks,
        "presence": by_shape[1, 1],
        "mask_every_16": by_shape[1, 256, 256, 1][::16, ::16],
        "heat_every_16": heat[::16, ::16],
        "positions": [refined(landmarks[5 * i : 5 * i + 2], heat[:, :, i]) for i in range(33)],
    }


def refined(position, logits):
    size = logits.shape[0]
    column, row = (np.asarray(position, dtype=np.float64) / SIDE * size).astype(int)
    if not (0 <= column < size and 0 <= row < size):
        return position
    top, left = max(row - 3, 0), max(column - 3, 0)
    window = 1 / (1 + np.exp(-logits[top : row + 4, left : column + 4].astype(np.float64)))
    if window.max() < 0.5:
        return position
    rows, columns = np.mgrid[top : top + window.shape[0], left : left + window.shape[1]]
    return np.array([(columns * window).sum(), (rows * window).sum()]) / window.sum() / size * SIDE


def main():
    here = Path(__file__).parent
    models, photos = Path(sys.argv[1]), sys.argv[2:]
    for name, photo in zip(NAMES, photos):
        make_input(photo, here / f"{name}.png")
    for network in ["lite", "full", "heavy"]:
        model = models / f"pose_landmark_{network}.tflite"
        lines = [
            f"{name} {key} " + " ".join(f"{v:.7g}" for v in np.ravel(values))
            for name in NAMES
            for key, values in outputs(model, here / f"{name}.png").items()
        ]
        (here / f"{network}.txt").write_text("\n".join(lines) + "\n")


main()
