"""Lists of the fields of a user's compiled model, by the treatment of each field when the robot is imported.

The import of a robot keeps a field, replaces the field by SimpleQuad's value, or reports that the robot lacks the
field. Other fields do not affect the motion. The lists are complete: a test fails if a field of MuJoCo is in no list or
in two lists.
"""


def _fields(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_SHOWN = _fields("""
    actuator_group cam_bodyid cam_fovy cam_intrinsic cam_ipd cam_mat0 cam_mode cam_output cam_pos cam_pos0
    cam_poscom0 cam_projection cam_quat cam_resolution cam_sensorsize cam_targetbodyid cam_user
    flex_elemtexcoord flex_flatskin flex_group flex_matid flex_rgba flex_texcoord flex_texcoordadr
    geom_castshadow geom_group geom_matid geom_rgba jnt_group light_active light_ambient light_attenuation
    light_bodyid light_bulbradius light_castshadow light_cutoff light_diffuse light_dir light_dir0
    light_exponent light_intensity light_mode light_pos light_pos0 light_poscom0 light_range light_softness
    light_specular light_targetbodyid light_texid light_type mat_emission mat_metallic mat_reflectance mat_rgba
    mat_roughness mat_shininess mat_specular mat_texid mat_texrepeat mat_texuniform mesh_facetexcoord
    mesh_texcoord mesh_texcoordadr mesh_texcoordnum site_bodyid site_dataid site_group site_matid site_pos
    site_quat site_rgba site_sameframe site_size site_type site_user skin_boneadr skin_bonebindpos
    skin_bonebindquat skin_bonebodyid skin_bonenum skin_bonevertadr skin_bonevertid skin_bonevertnum
    skin_bonevertweight skin_face skin_faceadr skin_facenum skin_group skin_inflate skin_matid skin_pathadr
    skin_rgba skin_texcoord skin_texcoordadr skin_vert skin_vertadr skin_vertnum stat tendon_group tendon_matid
    tendon_rgba tendon_width tex_adr tex_colorspace tex_contenttypeadr tex_data tex_height tex_nchannel
    tex_pathadr tex_type tex_width vis
""")
_NAMES = _fields("""
    actuator_user body_user geom_user jnt_user mesh_pathadr name_actuatoradr name_bodyadr name_camadr name_eqadr
    name_excludeadr name_flexadr name_geomadr name_hfieldadr name_jntadr name_keyadr name_lightadr name_matadr
    name_meshadr name_numericadr name_pairadr name_pluginadr name_sensoradr name_siteadr name_skinadr
    name_tendonadr name_texadr name_textadr name_tupleadr names names_map numeric_adr numeric_data numeric_size
    paths sensor_user tendon_user text_adr text_data text_size tuple_adr tuple_objid tuple_objprm tuple_objtype
    tuple_size
""")
_SENSORS = _fields("""
    sensor_adr sensor_cutoff sensor_datatype sensor_delay sensor_dim sensor_history sensor_historyadr
    sensor_interval sensor_intprm sensor_needstage sensor_noise sensor_objid sensor_objtype sensor_plugin
    sensor_refid sensor_reftype sensor_type
""")
_DERIVED = _fields("""
    B_colind B_rowadr B_rownnz D_colind D_diag D_rowadr D_rownnz M_colind M_rowadr M_rownnz actuator_acc0
    actuator_actadr actuator_actnum actuator_ctrladr actuator_ctrlnum actuator_historyadr actuator_length0
    actuator_outadr actuator_outnum body_bvhadr body_bvhnum body_conaffinity body_contype body_dofadr
    body_dofnum body_geomadr body_geomnum body_invweight0 body_jntadr body_jntnum body_margin body_parentid
    body_rootid body_sameframe body_simple body_subtreemass body_treeid body_weldid bvh_aabb bvh_child bvh_depth
    bvh_nodeid dof_M0 dof_Madr dof_bodyid dof_invweight0 dof_jntid dof_length dof_parentid dof_simplenum
    dof_treeid efm0_L efm0_L_colind efm0_L_rowadr efm0_L_rownnz efm0_dofid efmC_perm flex_bendingadr flex_bvhadr
    flex_bvhnum flex_edgeadr flex_edgeflap flex_edgenum flex_elemadr flex_elemdataadr flex_elemedge
    flex_elemedgeadr flex_elemlayer flex_elemnum flex_nodeadr flex_nodenum flex_plasticadr flex_shell
    flex_shelldataadr flex_shellnum flex_stiffnessadr flex_vertadr flex_vertcell flex_vertnum flexedge_J_colind
    flexedge_J_rowadr flexedge_J_rownnz flexedge_invweight0 flexedge_length0 flexedge_rigid flg_adhesion
    flg_gravcomp flg_surfacevel geom_aabb geom_bodyid geom_dataid geom_rbound geom_sameframe jnt_actuatorid
    jnt_bodyid jnt_dofadr jnt_plasticadr jnt_qposadr mapD2M mapM2D mapM2M mesh_bvhadr mesh_bvhnum mesh_extrema
    mesh_face mesh_faceadr mesh_facenormal mesh_facenum mesh_graph mesh_graphadr mesh_normal mesh_normaladr
    mesh_normalnum mesh_octadr mesh_octnum mesh_polyadr mesh_polymap mesh_polymapadr mesh_polymapnum
    mesh_polynormal mesh_polynum mesh_polyvert mesh_polyvertadr mesh_polyvertnum mesh_pos mesh_quat mesh_scale
    mesh_vertadr mesh_vertnum oct_aabb oct_child oct_coeff oct_depth pair_signature plugin_attradr
    plugin_stateadr plugin_statenum signature ten_J_colind ten_J_rowadr ten_J_rownnz tendon_actuatorid
    tendon_adr tendon_invweight0 tendon_length0 tendon_num tendon_plasticadr tendon_treeid tendon_treenum
    tree_bodyadr tree_bodynum tree_dofadr tree_dofnum
""")
"""Fields of `mujoco.MjModel` that MuJoCo computes from other fields; an import ignores them."""
_SIZES = _fields("""
    nB nC nD nJfe nJmom nJten nM na nactuator narena nbody nbuffer nbvh nbvhdynamic nbvhstatic ncam nconmax
    nefm0L nefm0dof nefmCvert nemax neq nexclude nflex nflexbending nflexedge nflexelem nflexelemdata
    nflexelemedge nflexnode nflexshelldata nflexstiffness nflextexcoord nflexvert ngeom ngravcomp nhfield
    nhfielddata nhistory njmax njnt nkey nlight nmat nmesh nmeshdegmax nmeshface nmeshgraph nmeshnormal
    nmeshpoly nmeshpolymap nmeshpolyvert nmeshtexcoord nmeshvert nmocap nnames nnames_map nnumeric nnumericdata
    noct nout npair npaths nplastic nplugin npluginattr npluginstate npolygonmax nq nsensor nsensordata nsite
    nskin nskinbone nskinbonevert nskinface nskintexvert nskinvert ntendon ntex ntexdata ntext ntextdata ntree
    ntuple ntupledata nu nuser_actuator nuser_body nuser_cam nuser_geom nuser_jnt nuser_sensor nuser_site
    nuser_tendon nuserdata nv nwrap
""")

KEPT = _fields("""
    body_mass body_inertia body_pos body_quat body_ipos body_iquat
    jnt_type jnt_pos jnt_axis jnt_limited jnt_range jnt_margin jnt_solref jnt_solimp jnt_stiffness
    jnt_stiffnesspoly jnt_actfrclimited jnt_actfrcrange
    dof_armature dof_damping dof_dampingpoly dof_frictionloss dof_solref dof_solimp
    geom_type geom_size geom_pos geom_quat geom_contype geom_conaffinity geom_friction geom_plugin
    mesh_vert
    exclude_signature
    pair_geom1 pair_geom2 pair_friction
    actuator_armature actuator_damping actuator_dampingpoly
    qpos0 qpos_spring plugin plugin_attr
""")
"""Fields of `mujoco.MjModel` with values that an imported robot keeps from the user's model.

The values are converted to the joint axes and zero angles of `Robot`. Armature and damping of a motor are added to its
joint. Spring, damping, armature and friction of the free joint are not kept; the module `omissions` reports them.
"""
REPLACED = _fields("""
    geom_condim geom_priority geom_margin geom_gap geom_solref geom_solimp geom_solmix geom_fluid
    pair_dim pair_margin pair_gap pair_solref pair_solreffriction pair_solimp
    actuator_trntype actuator_trnid actuator_gear actuator_cranklength actuator_lengthrange actuator_dyntype
    actuator_dynprm actuator_gaintype actuator_gainprm actuator_biastype actuator_biasprm actuator_ctrllimited
    actuator_ctrlrange actuator_ctrlspec actuator_forcelimited actuator_forcerange actuator_actlimited
    actuator_actrange actuator_actearly actuator_delay actuator_history actuator_plugin
    key_time key_qpos key_qvel key_act key_ctrl key_mpos key_mquat key_plastic
    opt
    tree_sleep_policy
    hfield_adr hfield_data hfield_ncol hfield_nrow hfield_pathadr hfield_size
""")
"""Fields of `mujoco.MjModel` with values of the user's model that an imported robot does not keep.

The robot gets SimpleQuad's values in these fields, or values computed from SimpleQuad's parameters; see
docs/your-robot.md.
"""
NAMED = _fields("""
    body_gravcomp body_plugin body_mocapid
    jnt_actgravcomp jnt_springyield
    geom_adhesion geom_surfacevel
    pair_adhesion
    eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 eq_data eq_solref eq_solimp
    tendon_type tendon_stiffness tendon_stiffnesspoly tendon_springyield tendon_lengthspring tendon_damping
    tendon_dampingpoly tendon_frictionloss tendon_armature tendon_limited tendon_range tendon_margin
    tendon_actfrclimited tendon_actfrcrange tendon_solref_lim tendon_solimp_lim tendon_solref_fri
    tendon_solimp_fri
    wrap_type wrap_objid wrap_prm
    flex_activelayers flex_bending flex_cellnum flex_centered flex_conaffinity flex_condim flex_contype
    flex_damping flex_dim flex_edge flex_edgedamping flex_edgeequality flex_edgestiffness flex_elem
    flex_friction flex_gap flex_interp flex_margin flex_node flex_node0 flex_nodebodyid flex_passive
    flex_plasticmode flex_priority flex_radius flex_rigid flex_selfcollide flex_size flex_solimp flex_solmix
    flex_solref flex_stiffness flex_vert flex_vert0 flex_vertbodyid flex_yield
""")
"""Fields of `mujoco.MjModel` that an imported robot lacks, although they can affect the motion.

If the user's model uses one of these fields, the module `omissions` reports this to the user.
"""
WITHOUT_EFFECT = _SHOWN + _NAMES + _SENSORS + _DERIVED + _SIZES
"""Fields of `mujoco.MjModel` that do not affect the motion, such as colours, names and sensors."""
MODEL_FIELDS = {"kept": KEPT, "replaced": REPLACED, "named": NAMED, "without effect": WITHOUT_EFFECT}
"""Treatment at the import of a user's model -> fields of `mujoco.MjModel` with this treatment."""
OPTION_FIELDS = {
    "kept": (),
    "replaced": _fields("""
        ccd_iterations ccd_tolerance cone impratio integrator iterations jacobian ls_iterations ls_tolerance
        noslip_iterations noslip_tolerance sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance
        disableactuator
    """),
    "named": _fields("""
        gravity density viscosity wind disableflags enableflags o_margin o_solref o_solimp o_friction
    """),
    "without effect": ("magnetic",),
}
"""Treatment at the import of a user's model -> fields of `mujoco.MjOption` with this treatment."""
