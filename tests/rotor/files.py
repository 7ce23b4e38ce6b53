"""Texts of files that describe one blade, each in the form of another program."""

DECK = """\
main file
{title}
1 beam_type
12.1 rot_rpm:
1.0 rpm_mult:
51.5 radius:
1.5 hub_rad:
0. precone:
0. bl_thp:
1 hub_conn:
100. tip_mass
'sec.dat' sec_props_file
1.0 sec_mass_mult:
1.0 flp_stff_mult:
1.0 edge_stff_mult:
1.0 axial_stff_mult:
"""
SECTIONS = """\
sections
3 n_secs
loc tw twi m fi ei fs es ts as cg sc tc
- - - - - - - - - - - - -
0.0 10 10 300 1 1 2e9 4e9 1e8 1e10 0 0 0
0.5  5  5 100 1 1 5e8 1e9 1e8 1e9  0 0 0
1.0  0  0  10 1 1 1e7 5e7 1e8 1e8  0 0 0
"""
ELASTODYN = """\
header
{title}
---
3 NBlInpSt
1 AdjBlMs
1 AdjFlSt
1 AdjEdSt
---
BlFract StrcTwst BMassDen FlpStff EdgStff
(-) (deg) (kg/m) (Nm^2) (Nm^2)
0.0 10.0 300.0 2.0E9 4.0E9
0.5 5.0 100.0 5.0E8 1.0E9
1.0 0.0 10.0 1.0E7 5.0E7
"""
CSV = """\
x_over_L,mass_per_length_kg_per_m,in_plane_stiffness_N_m2,flap_stiffness_N_m2
0,300,4e9,2e9
0.5,100,1e9,5e8
1,10,5e7,1e7
"""
# A main file with all lines, of version 3.00 (with cm_axial) and of 1.03 (without it).
WHOLE = """\
======================   BModes v{version} Main Input File  ==================
{title}

{general}
true      Echo        Echo input file contents to *.echo file if true.
1         beam_type   1: blade, 2: tower (-)
12.1      {speed}:    rotor speed (rpm), automatically set to zero for tower modal analysis
1.0       {speed_mult}:  rotor speed multiplicative factor (-)
51.5      radius:     rotor tip radius measured along coned blade axis OR tower height (m)
1.5       hub_rad:    hub radius measured along coned blade axis OR tower rigid-base height (m)
0.        precone:    built-in precone angle (deg), automatically set to zero for a tower
0.        bl_thp:     blade pitch setting (deg), automatically set to zero for a tower
1         hub_conn:   hub-to-blade connection [1: cantilevered]
20        modepr:     number of modes to be printed (-)
t         TabDelim    (true: tab-delimited output tables; false: space-delimited tables)
f         mid_node_tw  (true: output twist at mid-node of elements; false: no mid-node outputs)

{tip}
100.      tip_mass    blade-tip or tower-top mass (kg)
0.        cm_loc      tip-mass c.m. offset along the tip section y reference axis (m)
{axial}0.        ixx_tip     blade lag mass moment of inertia (kg-m^2)
0.        iyy_tip     blade flap mass moment of inertia (kg-m^2)
0.        izz_tip     torsion mass moment of inertia (kg-m^2)
0.        ixy_tip     cross product of inertia about x and y reference axes (kg-m^2)
0.        izx_tip     cross product of inertia about z and x reference axes (kg-m^2)
0.        iyz_tip     cross product of inertia about y and z reference axes (kg-m^2)

--------- Distributed-property identifiers --------------------------------------------------------
1         id_mat:     material_type [1: isotropic]
'sec.dat' sec_props_file   name of beam section properties file (-)

Property scaling factors..............................
1.0       sec_mass_mult:   mass density multiplier (-)
1.0       flp_iner_mult:   blade flap or tower f-a inertia multiplier (-)
1.0       lag_iner_mult:   blade lag or tower s-s inertia multiplier (-)
1.0       flp_stff_mult:   blade flap or tower f-a bending stiffness multiplier (-)
1.0       edge_stff_mult:  blade lag or tower s-s bending stiffness multiplier (-)
1.0       tor_stff_mult:   torsion stiffness multiplier (-)
1.0       axial_stff_mult: axial stiffness multiplier (-)
1.0       cg_offst_mult:   cg offset multiplier (-)
1.0       sc_offst_mult:   shear center multiplier (-)
1.0       tc_offst_mult:   tension center multiplier (-)

--------- Finite element discretization --------------------------------------------------
12        nselt:     no of blade or tower elements (-)
Distance of element boundary nodes from blade or flexible-tower root, el_loc()
0.  0.08  0.16  0.24  0.32  0.40  0.48  0.56  0.64  0.72  0.80  0.90   1.0
"""


def whole(version="3.00", speed="rot_rpm", speed_mult="rpm_mult", title="a blade", general="-----",
          tip="-----"):  # fmt: skip
    axial = "0.        cm_axial    tip-mass c.m. offset along the z axis (m)\n"
    return WHOLE.format(
        version=version, speed=speed, speed_mult=speed_mult, title=title, general=general, tip=tip,
        axial=axial if version == "3.00" else "",
    )  # fmt: skip
