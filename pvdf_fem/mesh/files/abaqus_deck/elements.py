"""Element types of Abaqus and CalculiX: which are triangles, and which are points or lines."""

from __future__ import annotations

import re

# Plane stress and strain, axisymmetric, membrane, surface, shell, rigid, heat and acoustic elements
# with the number of their nodes: CPS6M, CPE3H, CAX3, M3D6, SFM3D3, S3R, STRI65, DS3, R3D3, DC2D6.
_SURFACE = re.compile(
    r"(?:CPS|CPE|CPEG|CAX|CGAX|M3D|SFM3D|STRI|DS|S|R3D|DC2D|DCC2D|DCAX|DCCAX|AC2D|ACAX)(\d+)"
)
# Trusses, beams, pipes, springs, masses, connectors, and axisymmetric shells, which are lines.
_POINT_OR_LINE = re.compile(
    r"T2D|T3D|B[123]|PIPE|ELBOW|FRAME|SPRING|DASHPOT|MASS|ROTARYI|HEATCAP|CONN|JOINTC|GAP|DGAP"
    r"|DCOUP|R2D|RB[23]D|RAX|SAX|DSAX|MAX|MGAX|SFMAX|SFMGAX|DC1D|DCC1D|AC1D|IRS|ITS|PSI|D$"
)
#: Nodes of a triangle by the digits in the name of its type.
_NODES_OF_TRIANGLE = {"3": 3, "6": 6, "65": 6}


def count_triangle_nodes(element_type: str) -> int:
    """Count the nodes of a triangle of some type.

    Parameters
    ----------
    element_type : str
        Name of the type in capital letters, such as ``CPS6``.

    Returns
    -------
    int
        3 or 6; 0 if the elements of this type are not triangles.
    """
    match = _SURFACE.match(element_type)
    return _NODES_OF_TRIANGLE.get(match[1], 0) if match else 0


def is_point_or_line(element_type: str) -> bool:
    """Return whether the elements of a type are points or lines.

    Parameters
    ----------
    element_type : str
        Name of the type in capital letters, such as ``T3D2``.

    Returns
    -------
    bool
    """
    return _POINT_OR_LINE.match(element_type) is not None
