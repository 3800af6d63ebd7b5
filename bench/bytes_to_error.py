#!/usr/bin/env python3
"""Bytes of a pyramid's tiles (brotli 11), or of a progressive stream, to mean errors that another format reaches by known bytes.

    bench/bytes_to_error.py CLOUD.ply --method multiphase ERROR:BYTES...
    bench/bytes_to_error.py CLOUD.ply --stream ERROR:BYTES...

ERROR in percent of the diagonal, as 0.0299:86857. For each, levels of ratio 4 are made whose finest, decoded, has that error; printed
are its points, its bytes, and those of all levels, each beside BYTES; of a stream the shortest prefix that has that error. Needs numpy, scipy, and `stipple`, `brotli` in PATH.

The error is not that of §4 (surface_distance.cpp) but the one by which those bytes were found: the mean distance of every
point of the cloud from a plane of its 12 nearest in the level, Gaussian weights, three steps. The width of the Gaussian, which
was not told, is set so that random subsets have the errors told of them (igea 8,396 and 33,586 points: 0.0663 and 0.0229 %; dragon 27,352
and 109,411: 0.0551 and 0.0154 %).
"""
import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

NEIGHBORS = 12
STEPS = 3
WIDTH = 0.585  # of the distance to the last neighbour
COARSEST = 10_000
TRIES = 8
CLOSE = 0.002


def positions(path):
    """Positions of a PLY that stipple wrote: x, y, z float32 among scalar properties. Shape (n, 3), float64."""
    with open(path, 'rb') as file:
        properties = []
        while (line := file.readline().split()) != [b'end_header']:
            if line[:2] == [b'element', b'vertex']:
                count = int(line[2])
            if line[0] == b'property':
                properties.append((line[2].decode(), {b'float': '<f4', b'uchar': 'u1', b'double': '<f8'}[line[1]]))
        points = np.fromfile(file, dtype=properties, count=count)
    return np.stack([points[axis] for axis in 'xyz'], axis=1).astype(float)


def mean_error(cloud, level):
    """In percent of the cloud's diagonal. Both of shape (n, 3)."""
    tree = cKDTree(level)
    places = cloud.copy()
    for _ in range(STEPS):
        distances, nearest = tree.query(places, k=NEIGHBORS)
        around = level[nearest]
        width = np.maximum(WIDTH * distances[:, -1:], np.finfo(float).tiny)
        weights = np.exp(-(distances / width) ** 2)
        weights /= weights.sum(axis=1, keepdims=True)
        center = np.einsum('nk,nkc->nc', weights, around)
        offsets = around - center[:, None]
        _, vectors = np.linalg.eigh(np.einsum('nk,nki,nkj->nij', weights, offsets, offsets))
        normal = vectors[:, :, 0]
        places -= np.einsum('nc,nc->n', places - center, normal)[:, None] * normal
    diagonal = np.linalg.norm(np.ptp(cloud, axis=0))
    return 100 * np.linalg.norm(cloud - places, axis=1).mean() / diagonal


def brotli_bytes(path):
    return len(subprocess.run(['brotli', '-q', '11', '-w', '22', '-c', path], check=True, capture_output=True).stdout)


def sizes_up_to(points):
    sizes = [points]
    while sizes[0] > COARSEST:
        sizes.insert(0, sizes[0] // 4)
    return sizes


def measured(path, cloud, method, points, folder):
    """Error of the finest level and the bytes of each, of a pyramid that ends at so many points."""
    levels = Path(folder, str(points))
    sizes = sizes_up_to(points)
    subprocess.run(['stipple', 'pyramid', path, levels, '--method', method, '--formats', 'glb', '--no-error', '--quiet',
                    '--levels', ','.join(map(str, sizes))], check=True)
    finest = levels / 'finest.ply'
    subprocess.run(['stipple', 'slice', levels, finest, '--points', str(points), '--quiet'], check=True)
    manifest = json.loads((levels / 'manifest.json').read_text())
    sent = [sum(brotli_bytes(levels / file['href']) for file in level['files']) for level in manifest['levels']]
    return mean_error(cloud, positions(finest)), sent


def ladder_to(error, path, cloud, method, folder):
    """Error, points, and bytes of each level of the pyramid whose finest level comes closest to the error."""
    points, below, above = len(cloud) // 8, 1, len(cloud)
    tries = []
    while len(tries) < TRIES and not any(off < CLOSE for off, *_ in tries):
        found, sent = measured(path, cloud, method, points, folder)
        tries.append((abs(found / error - 1), found, points, sent))
        below, above = (points, above) if found > error else (below, points)
        points = int(np.clip(points * (found / error) ** 0.75, below + 1, above - 1))
    return min(tries)[1:]


def stream_of(path, folder):
    levels = Path(folder, 'stream')
    subprocess.run(['stipple', 'pyramid', path, levels, '--method', 'iterative', '--formats', 'stpc', '--no-error', '--quiet'],
                   check=True)
    (file,) = levels.glob('*.stpc')
    return file.read_bytes()


def prefix_to(error, stream, cloud, folder):
    """Error, points and bytes of a prefix that has the error, found by halving."""
    cut, shown = Path(folder, 'prefix.stpc'), Path(folder, 'prefix.ply')
    below, above = 1_000, len(stream)
    best = None
    while above / below > 1 + CLOSE:
        size = int(np.sqrt(below * above))
        cut.write_bytes(stream[:size])
        subprocess.run(['stipple', 'convert', cut, shown, '--quiet'], check=True)
        level = positions(shown)
        found = mean_error(cloud, level)
        if found > error:
            below = size
        else:
            above, best = size, (found, len(level), size)
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('cloud')
    parser.add_argument('--method', default='hierarchical')
    parser.add_argument('--stream', action='store_true')
    parser.add_argument('reached', nargs='+', metavar='ERROR:BYTES')
    args = parser.parse_args()
    reached = [tuple(map(float, each.split(':'))) for each in args.reached]
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, 'cloud.ply')
        subprocess.run(['stipple', 'convert', args.cloud, plain, '--quiet'], check=True)
        cloud = positions(plain)
        if args.stream:
            stream = stream_of(plain, folder)
            print('| error, % | points | stream, bytes | of theirs |\n|---|---|---|---|')
            for error, theirs in reached:
                found, points, size = prefix_to(error, stream, cloud, folder)
                print(f'| {found:.5f} | {points:,} | {size:,} | {size / theirs:.2f} |')
        else:
            print('| error, % | points | level, bytes | of theirs | ladder, bytes | of theirs |\n|---|---|---|---|---|---|')
            for error, theirs in reached:
                found, points, sent = ladder_to(error, plain, cloud, args.method, folder)
                print(f'| {found:.5f} | {points:,} | {sent[-1]:,} | {sent[-1] / theirs:.2f} | {sum(sent):,} | {sum(sent) / theirs:.2f} |')


if __name__ == '__main__':
    main()
