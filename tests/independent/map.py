"""What `tog map export` and `tog map merge` wrote, read by programs that share nothing with tog.

map.py nav2 MAP NAV2 CLASS SHARE   every cell of map.pgm, loaded as nav2's map_server does, says what the
                                   counts of MAP say
map.py npy MAP NPY                 the same counts, and their shares
map.py sum SUM MAP..               the counts of SUM are those of the others added

Written from the documentation of map_server (image, resolution, origin, negate, thresholds; the
first row of the image is the highest) and of tog's files, with NumPy and a YAML parser.
"""

import json
import sys
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML


def read_pgm(path):
    """A binary PGM as [row, column], its first row first."""
    data, fields, at = path.read_bytes(), [], 0
    while len(fields) < 4:
        end = at
        while data[end : end + 1] not in (b" ", b"\n", b"\t", b"\r", b"#", b""):
            end += 1
        if data[end : end + 1] == b"#":
            at = data.index(b"\n", end) + 1
            continue
        if end > at:
            fields.append(data[at:end])
        at = end + 1
    assert fields[0] == b"P5" and fields[3] == b"255", fields
    columns, rows = int(fields[1]), int(fields[2])
    assert len(data) - at == rows * columns, "as many pixels as the head says"
    return np.frombuffer(data, np.uint8, offset=at).reshape(rows, columns)


def load_as_map_server(directory):
    """Cells [row, column], row 0 lowest: 100 occupied, 0 free, -1 unknown."""
    head = YAML(typ="safe", pure=True).load(directory / "map.yaml")
    assert head["mode"] == "trinary" and head["image"] == "map.pgm", head
    pixels = read_pgm(directory / head["image"]).astype(float)
    p = pixels / 255.0 if head["negate"] else (255.0 - pixels) / 255.0
    cells = np.full(p.shape, -1)
    cells[p > head["occupied_thresh"]] = 100
    cells[p < head["free_thresh"]] = 0
    return head, cells[::-1]


def read_map(directory):
    return json.loads((directory / "grid.json").read_text()), np.load(directory / "collapsed_counts.npy")


def nav2(folder, exported, name, share):
    grid, counts = read_map(Path(folder))
    head, cells = load_as_map_server(Path(exported))
    assert head["resolution"] == grid["cell_m"], head
    assert head["origin"] == [*grid["origin_m"], 0.0], head
    total = counts.sum(axis=0)
    wanted = np.where(counts[[c["name"] for c in grid["classes"]].index(name)] >= float(share) * total, 100, 0)
    wanted[total == 0] = -1
    assert cells.shape == wanted.shape == (grid["rows"], grid["columns"])
    assert (cells == wanted).all(), f"{(cells != wanted).sum()} cells differ"
    kinds = [int((wanted == kind).sum()) for kind in (100, 0, -1)]
    assert all(kinds), f"a map without one of the kinds shows nothing: {kinds}"
    print(f"nav2: {kinds[0]} occupied, {kinds[1]} free, {kinds[2]} unknown cells agree")


def npy(folder, exported):
    grid, counts = read_map(Path(folder))
    other_grid, other = read_map(Path(exported))
    assert other_grid == grid
    assert counts.dtype == other.dtype == np.uint64 and (counts == other).all()
    assert counts.shape == (len(grid["classes"]), grid["rows"], grid["columns"])
    shares = np.load(Path(exported) / "shares.npy")
    with np.errstate(invalid="ignore"):
        wanted = counts / counts.sum(axis=0)
    assert np.array_equal(shares, wanted, equal_nan=True)
    print(f"npy: {counts.size} counts and shares agree")


def added(total, *folders):
    counts = [read_map(Path(folder))[1] for folder in folders]
    assert (read_map(Path(total))[1] == sum(counts)).all()
    print(f"sum: the counts of {len(folders)} maps agree")


if __name__ == "__main__":
    {"nav2": nav2, "npy": npy, "sum": added}[sys.argv[1]](*sys.argv[2:])
    print("verdict: every number agrees")
