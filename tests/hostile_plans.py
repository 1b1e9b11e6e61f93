"""Floor plans that cost whoever draws them much more than whoever sends them.

All of them are valid files of their kind; each maker takes how bad it is to be.
"""

import json
import struct
import zlib
from collections.abc import Callable

SVG, PDF, PNG, JPEG = "image/svg+xml", "application/pdf", "image/png", "image/jpeg"
GEOJSON = "application/geo+json"
RECT = '<rect width="1000" height="1000" fill="black"/>'
EOB_RUN_BITS = 14
"""Of a progressive JPEG: so many blocks, as a power of two, end at one symbol."""


def _svg(inside: str) -> bytes:
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1000 1000">'
    return f"{head}{inside}</svg>".encode()


def masks(count: int = 500) -> bytes:
    """An SVG in which so many groups are masked, each over the whole drawing."""
    mask = f'<mask id="m">{RECT}</mask>'
    return _svg(mask + f'<g mask="url(#m)">{RECT}</g>' * count)


def mask_chain(length: int = 500) -> bytes:
    """An SVG whose masks are masked by masks."""
    chain = "".join(
        f'<mask id="m{k}"><g mask="url(#m{k + 1})">{RECT}</g></mask>' for k in range(length)
    )
    return _svg(f'{chain}<mask id="m{length}">{RECT}</mask><g mask="url(#m0)">{RECT}</g>')


def nested_opacity(depth: int = 90) -> bytes:
    """An SVG whose groups are translucent, one in the other."""
    return _svg('<g opacity="0.99">' * depth + RECT * 2 + "</g>" * depth)


def uses_of_uses(levels: int = 9, each: int = 10) -> bytes:
    """An SVG that unfolds to `each` ** `levels` rectangles."""
    groups = "".join(
        f'<g id="u{k}">' + f'<use href="#u{k + 1}"/>' * each + "</g>" for k in range(levels)
    )
    return _svg(f'<defs>{groups}<g id="u{levels}">{RECT}</g></defs><use href="#u0"/>')


def long_path(size_bytes: int = 15_000_000) -> bytes:
    """An SVG with one dashed path of that many characters."""
    stretch = "".join(f"L{k * 379 % 1000} {k * 617 % 1000}" for k in range(1000))
    steps = stretch * (size_bytes // len(stretch) + 1)
    return _svg(f'<path d="M0 0{steps}" fill="none" stroke="black" stroke-dasharray="1 1"/>')


def _pdf(drawing: bytes) -> bytes:
    """A page whose content is `drawing`, already deflated."""
    bodies = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 400 300] /Contents 4 0 R >>",
        b"<< /Length %d /Filter /FlateDecode >>\nstream\n%s\nendstream" % (len(drawing), drawing),
    ]
    content, places = b"%PDF-1.4\n", []
    for number, body in enumerate(bodies, start=1):
        places.append(len(content))
        content += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    start = len(content)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    content += b"xref\n0 5\n0000000000 65535 f \n%s" % table
    return content + b"trailer\n<< /Size 5 /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % start


def _deflated(piece: bytes, count: int) -> bytes:
    packer = zlib.compressobj(9)
    return b"".join([*(packer.compress(piece) for _ in range(count)), packer.flush()])


def unfolding_pdf(size_bytes: int = 1_000_000_000) -> bytes:
    """A PDF whose page unfolds to so many spaces."""
    piece = b" " * 1_000_000
    return _pdf(_deflated(piece, size_bytes // len(piece)))


def operator_pdf(operators: int = 5_000_000) -> bytes:
    """A PDF whose page is drawn by so many operators."""
    piece = b"0 0 m 9 9 l S " * 1000
    return _pdf(_deflated(piece, operators // 3000))


def png_bomb(side_px: int = 6320) -> bytes:
    """A PNG of nothing, a thousand times smaller than its pixels in RGBA."""
    head = struct.pack(">IIBBBBB", side_px, side_px, 8, 6, 0, 0, 0)
    row = bytes(1 + 4 * side_px)
    parts = [(b"IHDR", head), (b"IDAT", _deflated(row, side_px)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in parts
    )


def scanned_jpeg(scans: int = 3000, side_px: int = 6320) -> bytes:
    """A grey progressive JPEG that says in so many scans that no block of it changes."""
    blocks = (-(-side_px // 8)) ** 2
    dc = bytes(-(-blocks // 8))
    runs, rest = divmod(blocks, 1 << EOB_RUN_BITS)
    bits = f"0{0:0{EOB_RUN_BITS}b}" * runs + "".join(
        f"{_code_of_run(size)}{0:0{size}b}" for size in range(EOB_RUN_BITS) if rest >> size & 1
    )
    ac = _stuffed(bits)
    scan = _segment(0xDA, bytes([1, 1, 0x00, 1, 63, 0x21])) + ac
    first = _segment(0xDA, bytes([1, 1, 0x00, 1, 63, 0x02])) + ac
    lengths = [1, 0, 0, 0, EOB_RUN_BITS, *[0] * 11]
    runs_of = [EOB_RUN_BITS << 4, *(size << 4 for size in range(EOB_RUN_BITS))]
    return b"".join(
        [
            b"\xff\xd8",
            _segment(0xDB, bytes([0]) + bytes([1] * 64)),
            _segment(0xC2, struct.pack(">BHHB", 8, side_px, side_px, 1) + bytes([1, 0x11, 0])),
            _segment(0xC4, bytes([0x00, 1, *[0] * 15, 0])),
            _segment(0xC4, bytes([0x10, *lengths, *runs_of])),
            _segment(0xDA, bytes([1, 1, 0x00, 0, 0, 0x00])) + dc,
            first,
            scan * scans,
            b"\xff\xd9",
        ]
    )


def _code_of_run(size: int) -> str:
    """The longest run has the code 0, the others 10000 and on."""
    return f"{0b10000 + size:05b}"


def _stuffed(bits: str) -> bytes:
    padded = bits + "1" * (-len(bits) % 8)
    return int(padded, 2).to_bytes(len(padded) // 8, "big").replace(b"\xff", b"\xff\x00")


def _segment(marker: int, data: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data


def deep_geojson(depth: int = 200_000) -> bytes:
    """GeoJSON whose coordinates are arrays in arrays."""
    return json.dumps({"type": "Polygon"})[:-1].encode() + b', "coordinates": ' + b"[" * depth


PLANS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "SVG masks": (SVG, masks),
    "progressive JPEG": (JPEG, scanned_jpeg),
    "PNG bomb": (PNG, png_bomb),
    "unfolding PDF": (PDF, unfolding_pdf),
    "SVG of 90 masks": (SVG, lambda: masks(90)),
    "JPEG of 97 scans": (JPEG, lambda: scanned_jpeg(97)),
    "SVG mask chain": (SVG, mask_chain),
    "SVG nested opacity": (SVG, nested_opacity),
    "SVG long path": (SVG, long_path),
    "operator PDF": (PDF, operator_pdf),
    "deep GeoJSON": (GEOJSON, deep_geojson),
    "SVG uses of uses": (SVG, uses_of_uses),
}
"""Media type and maker by name."""
