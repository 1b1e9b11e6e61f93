"""Small whole floor plans as other programs write them: two rooms of 16 m by 24 m in all."""

SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30">'
    '<rect x="4" y="3" width="32" height="24" fill="none" stroke="black" stroke-width="0.4"/>'
    '<line x1="20" y1="3" x2="20" y2="15" stroke="black" stroke-width="0.4"/></svg>'
)


ROOMS = b"2 w 40 30 320 240 re S 200 270 m 200 150 l S"


def pdf(pages: int = 1, drawing: bytes = ROOMS, size: str = "400 300") -> bytes:
    """A page of 400 by 300 points: the same rooms, drawn by hand; or another drawing."""
    kids = " ".join(f"{3 + 2 * k} 0 R" for k in range(pages))
    bodies = [b"<< /Type /Catalog /Pages 2 0 R >>"]
    bodies.append(f"<< /Type /Pages /Kids [{kids}] /Count {pages} >>".encode())
    for k in range(pages):
        page = f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents {4 + 2 * k} 0 R >>"
        bodies.append(page.encode())
        bodies.append(b"<< /Length %d >>\nstream\n%s\nendstream" % (len(drawing), drawing))
    content, places = b"%PDF-1.4\n", []
    for number, body in enumerate(bodies, start=1):
        places.append(len(content))
        content += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    size = len(bodies) + 1
    content += b"xref\n0 %d\n0000000000 65535 f \n%s" % (size, table)
    start = content.rindex(b"xref\n")
    return content + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        size,
        start,
    )
