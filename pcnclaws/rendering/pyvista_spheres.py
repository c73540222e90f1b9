"""Shaded spheres by PyVista, in place of our own: smooth surfaces with highlights."""

import importlib
from typing import Any

import numpy as np

from pcnclaws.errors import not_installed
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.stage import LIGHT

# Facets of a sphere around its axis and along it.
FACETS = 14


def require_pyvista() -> Any:
    """PyVista; UserError with the way to install it where it is missing."""
    try:
        # without a display VTK says so before it draws without one
        logger = importlib.import_module("vtkmodules.vtkCommonCore").vtkLogger
        logger.SetStderrVerbosity(logger.VERBOSITY_ERROR)
        return importlib.import_module("pyvista")
    except ImportError as error:
        raise not_installed("renderer=pyvista", "pyvista", "pyvista", "renderer=matplotlib") from error


def pyvista_spheres(
    camera: Camera, position: np.ndarray, radius: np.ndarray, colour: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As shaded_spheres."""
    pyvista = require_pyvista()
    plotter = pyvista.Plotter(off_screen=True, window_size=(camera.width, camera.height), lighting="none")
    points = pyvista.PolyData(position.astype(np.float32))
    points["radius"], points["colour"] = radius.astype(np.float32), np.rint(255.0 * colour).astype(np.uint8)
    ball = pyvista.Sphere(radius=1.0, theta_resolution=FACETS, phi_resolution=FACETS)
    spheres = points.glyph(geom=ball, scale="radius", orient=False)
    plotter.add_mesh(
        spheres,
        scalars="colour",
        rgb=True,
        smooth_shading=True,
        ambient=0.35,
        diffuse=0.6,
        specular=0.25,
        specular_power=20,
    )
    sun = pyvista.Light(light_type="scene light", intensity=0.9)
    sun.set_direction_angle(0.0, 0.0)
    sun.positional = False
    sun.position, sun.focal_point = tuple(camera.eye + LIGHT), tuple(camera.eye)
    plotter.add_light(sun)
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.35))
    _place(plotter.camera, camera)
    picture = plotter.screenshot(return_img=True, transparent_background=True)[..., :3] / 255.0
    depth = -np.asarray(plotter.get_image_depth(), dtype=np.float32)
    plotter.close()
    return picture.astype(np.float32), np.where(np.isfinite(depth), depth, np.float32(np.inf))


def _place(theirs: Any, camera: Camera) -> None:
    """Makes PyVista's camera see what ours does."""
    left, top, right, bottom = camera.window
    _, up, towards = camera.axes
    theirs.position, theirs.focal_point, theirs.up = tuple(camera.eye), tuple(camera.eye - towards), tuple(up)
    theirs.view_angle = float(np.degrees(2.0 * np.arctan(0.5 * (top - bottom))))
    theirs.SetWindowCenter((left + right) / (right - left), (top + bottom) / (top - bottom))
    theirs.clipping_range = (0.05, 20.0)
