"""A calibration in files: `calibration.json`, pictures of the corners found, one HTML page."""

import base64
import html
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from fusionnet.views.calibration import CalibratedEnvironment, Calibration
from fusionnet.views.picture_file import read_picture

CALIBRATION_FILE = "calibration.json"
KIND = "fusionnet calibration"
SCHEMA_VERSION = 2
REPORT_FILE = "calibration.html"
SHOWN = 12
"""Pictures of corners for an environment: those with the largest errors come first."""

WIDTH = 320
"""Of a picture in the report, in pixels."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em; }
table { border-collapse: collapse; } td, th { padding: .2em .8em; text-align: right; }
td:first-child, th:first-child { text-align: left; } th { border-bottom: 1px solid #999; }
img { max-width: 100%; }
"""


def as_json(calibration: Calibration) -> dict[str, Any]:
    """Everything that was found, as numbers: lengths in pixels, errors a photograph."""
    return {
        "kind": KIND,
        "schema_version": SCHEMA_VERSION,
        "board": {
            "columns": calibration.board.columns,
            "rows": calibration.board.rows,
            "square": calibration.board.square,
        },
        "size": list(calibration.size),
        "matrix": calibration.matrix.tolist(),
        "undistorted_to": calibration.undistorted_to.tolist(),
        "mean_reprojection_error": calibration.mean_error,
        "environments": {
            each.environment.name: {
                "orientation": each.environment.orientation,
                "fisheye_matrix": each.lens.matrix.tolist(),
                "fisheye_coefficients": each.lens.coefficients.tolist(),
                "photographs": [
                    {
                        "file": photograph.file.name,
                        "fisheye_error": round(float(fisheye), 4),
                        "pinhole_error": round(float(pinhole), 4),
                    }
                    for photograph, fisheye, pinhole in zip(
                        each.used, each.fisheye_errors, each.pinhole_errors, strict=True
                    )
                ],
            }
            for each in calibration.environments
        },
        "left_out": [
            {"photograph": photograph.name, "reason": photograph.reason}
            for photograph in calibration.left_out
        ],
    }


def write_report(folder: Path, calibration: Calibration) -> None:
    """Write the JSON and the page into a folder that exists."""
    text = json.dumps(as_json(calibration), indent=1) + "\n"
    (folder / CALIBRATION_FILE).write_text(text, encoding="utf-8")
    (folder / REPORT_FILE).write_text(_page(calibration), encoding="utf-8")


def corners_found(
    calibration: Calibration, environment: CalibratedEnvironment
) -> UInt8[np.ndarray, "h w 3"]:
    """Photographs with the corners that were found, the largest errors first."""
    board = calibration.board.inner
    tiles = []
    for index in np.argsort(-environment.fisheye_errors)[:SHOWN]:
        photograph = environment.used[index]
        assert photograph.corners is not None
        image = read_picture(photograph.file).copy()
        corners = photograph.corners.astype(np.float32)[:, None]
        cv2.drawChessboardCorners(image, board, corners, True)
        tile = cv2.resize(
            image, (WIDTH, WIDTH * image.shape[0] // image.shape[1]), interpolation=cv2.INTER_AREA
        )
        words = f"{photograph.file.name[:24]}  {environment.fisheye_errors[index]:.2f} px"
        cv2.rectangle(tile, (0, 0), (9 * len(words), 20), (255, 255, 255), -1)
        cv2.putText(tile, words, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % 3)
    return np.vstack([np.hstack(tiles[i : i + 3]) for i in range(0, len(tiles), 3)])


def _page(calibration: Calibration) -> str:
    matrix = calibration.matrix
    parts = [
        "<!doctype html><meta charset=utf-8><title>Calibration</title>",
        f"<style>{_STYLE}</style><h1>Calibration</h1>",
        f"<p>Board of {calibration.board.columns} × {calibration.board.rows} squares of "
        f"{1000 * calibration.board.square:.2f} mm. One pinhole camera over all: "
        f"f<sub>x</sub> {matrix[0, 0]:.2f}, f<sub>y</sub> {matrix[1, 1]:.2f}, "
        f"c<sub>x</sub> {matrix[0, 2]:.2f}, c<sub>y</sub> {matrix[1, 2]:.2f} pixels; "
        f"mean reprojection error {calibration.mean_error:.3f} pixels.</p>",
    ]
    for each in calibration.environments:
        picture = cv2.cvtColor(corners_found(calibration, each), cv2.COLOR_RGB2BGR)
        _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
        lens = each.lens
        parts += [
            f"<h2>{html.escape(each.environment.name)}</h2><p>Fisheye lens: f "
            f"{lens.matrix[0, 0]:.2f} / {lens.matrix[1, 1]:.2f} pixels, k "
            f"{', '.join(f'{k:.4f}' for k in lens.coefficients)}. {len(each.used)} of "
            f"{len(each.environment.photographs)} photographs used. Corners found, the largest "
            f"errors first:</p><p><img alt='corners found' src='data:image/jpeg;base64,"
            f"{base64.b64encode(jpeg.tobytes()).decode()}'></p>",
            _table(
                ("photograph", "fisheye [px]", "pinhole [px]"),
                [
                    (photograph.file.name, f"{fisheye:.3f}", f"{pinhole:.3f}")
                    for photograph, fisheye, pinhole in zip(
                        each.used, each.fisheye_errors, each.pinhole_errors, strict=True
                    )
                ],
            ),
        ]
    if calibration.left_out:
        rows: list[tuple[str, ...]] = [
            (photograph.name, photograph.reason) for photograph in calibration.left_out
        ]
        parts += ["<h2>Left out</h2>", _table(("photograph", "reason"), rows)]
    return "\n".join(parts)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    cells = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{cells}</tr>{body}</table>"
