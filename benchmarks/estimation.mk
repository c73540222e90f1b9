# The estimates of docs/estimation.md: the paper's nine objects from its own guesses. `make estimation` makes what is missing.
ESTIMATES := docs/results/estimation
SEEN := outputs/estimation

# object: truth, motion and the paper's guess
nine := elasticity_1 elasticity_2 elasticity_3 plasticine_1 plasticine_2 plasticine_3 sand_1 sand_2 sand_3
elastic = parameters.youngs_modulus=$(1) parameters.poissons_ratio=$(2)
guess = initial_guess.youngs_modulus=$(1) initial_guess.poissons_ratio=$(2)
truth_elasticity_1 := $(call elastic,1.8e5,0.13)
truth_elasticity_2 := $(call elastic,1.4e5,0.18)
truth_elasticity_3 := $(call elastic,2.0e5,0.15)
truth_plasticine_1 := $(call elastic,4.7e5,0.36) parameters.yield_stress=4.2e3
truth_plasticine_2 := $(call elastic,5.3e5,0.31) parameters.yield_stress=5.1e3
truth_plasticine_3 := $(call elastic,4.2e5,0.33) parameters.yield_stress=5.7e3
truth_sand_1 := $(call elastic,3.7e5,0.18) parameters.friction_angle=30
truth_sand_2 := $(call elastic,4.2e5,0.23) parameters.friction_angle=26
truth_sand_3 := $(call elastic,3.3e5,0.20) parameters.friction_angle=22
guess_elasticity_1 := $(call guess,5e4,0.02)
guess_elasticity_2 := $(call guess,5e4,0.5)
guess_elasticity_3 := $(call guess,1e5,0.03)
guess_plasticine_1 := $(call guess,5e4,0.10) initial_guess.yield_stress=1.0e3
guess_plasticine_2 := $(call guess,1e5,0.10) initial_guess.yield_stress=1.5e3
guess_plasticine_3 := $(call guess,1e5,0.05) initial_guess.yield_stress=2e3
guess_sand_1 := $(call guess,1e5,0.05) initial_guess.friction_angle=10
guess_sand_2 := $(call guess,1e5,0.1) initial_guess.friction_angle=8
guess_sand_3 := $(call guess,1e5,0.05) initial_guess.friction_angle=5
# as the test objects of the data sets move,
# in the paper's setting: particles on the faces, C = 0 at the start
paper := scene.lattice=faces scene.affine=zero
motion_1 := 'scene.velocity=[1.0,-1.5,-2.0]' 'scene.spin=[2.0,2.0,2.0]'
motion_2 := 'scene.velocity=[1.0,-1.5,-1.5]'
motion_3 := 'scene.velocity=[-0.5,-2.5,1.0]'

# ways of estimating, from the motion of all particles
ways := analytic analytic_unscreened pretrained pretrained_unscreened adam
way_analytic := law=analytic
way_analytic_unscreened := law=analytic screening=0
way_pretrained := law=pretrained
way_pretrained_unscreened := law=pretrained screening=0
way_adam := law=pretrained screening=0 estimator=adam
# a guess of Young's modulus that is ten times off, for the first object of each material
tenfold := softer stiffer stiffer_unscreened
firsts := elasticity_1 plasticine_1 sand_1
way_softer = law=pretrained initial_guess.youngs_modulus=$(softer_$(1))
way_stiffer = law=pretrained initial_guess.youngs_modulus=$(stiffer_$(1))
way_stiffer_unscreened = $(way_stiffer) screening=0
softer_elasticity_1 := 1.8e4
softer_plasticine_1 := 4.7e4
softer_sand_1 := 3.7e4
stiffer_elasticity_1 := 1.8e6
stiffer_plasticine_1 := 4.7e6
stiffer_sand_1 := 3.7e6
# from a hundred noisy markers on the surface, with gaps, seen in every tenth frame; the start velocity is not known
seen_by_markers := surface=true every=10 noise=1e-3 missing=0.1
way_markers := law=analytic scene.shape=cube $(paper)
# from 500 points on the surface in every fifth step, other ones each time, without labels, of the half that a camera
# above a corner sees; start velocity, spin and the offset of the surface are not known
seen_by_a_depth_camera := kind=points points=500 'camera=[1,1,1]' noise=2e-3
way_points := law=analytic observation.kind=points scene.shape=cube $(paper)
# as the hundred markers, of a motion that was simulated with half, or a third, of the time step, grid spacing and distance
# of particles; where the walls are felt is estimated along
finer := simulation.time_step=2.5e-4 simulation.grid_nodes=40 simulation.steps=1000 simulation.every=10 scene.particles_per_edge=20
finest := simulation.time_step=1.6666666666666667e-4 simulation.grid_nodes=60 simulation.steps=1500 simulation.every=15 \
	scene.particles_per_edge=30
way_mismatched := law=analytic scene.shape=cube unknown.walls=true discrepancy=true screening=8 estimator.iterations=12
# the same, and the size of the body; the estimate goes on with grids that are none of those of the motions, and finds the
# spacing that the motion is most like
way_refined := law=analytic scene.shape=cube unknown.walls=true unknown.size=true discrepancy=true 'refinements=[1.5,2.5]' \
	screening=8 estimator.iterations=5

material_of = $(firstword $(subst _, ,$(1)))
number_of = $(lastword $(subst _, ,$(1)))

# $(call seen_finer,object,word,settings,share of the particles): a motion by other settings, and markers of it
define seen_finer
$(SEEN)/$(1)_$(2).h5: | $(INSTALLED)
	$$(RUN) pcnclaws.simulate material=$(call material_of,$(1)) law=analytic $(truth_$(1)) $(motion_$(call number_of,$(1))) $(paper) $(3) \
		scene.name=$(1) picture=false threads=1 output=$$@

$(SEEN)/$(1)_$(2)_markers.csv: | $(SEEN)/$(1)_$(2).h5
	$$(RUN) pcnclaws.observe file=$(SEEN)/$(1)_$(2).h5 markers=$(4) $(seen_by_markers) output=$$@

endef

# $(call seen,object): its motion by the analytic law, and what markers show of it
define seen
$(SEEN)/$(1).h5: | $(INSTALLED)
	$$(RUN) pcnclaws.simulate material=$(call material_of,$(1)) law=analytic $(truth_$(1)) $(motion_$(call number_of,$(1))) $(paper) \
		scene.name=$(1) picture=false threads=1 output=$$@

$(SEEN)/$(1)_markers.csv: | $(SEEN)/$(1).h5
	$$(RUN) pcnclaws.observe file=$(SEEN)/$(1).h5 markers=0.1 $(seen_by_markers) output=$$@

$(SEEN)/$(1)_points.npz: | $(SEEN)/$(1).h5
	$$(RUN) pcnclaws.observe file=$(SEEN)/$(1).h5 $(seen_by_a_depth_camera) output=$$@

$(call seen_finer,$(1),fine,$(finer),0.0125)
$(call seen_finer,$(1),finest,$(finest),0.0037037)

$(foreach way,$(ways),$(call estimated,$(1),$(way),$(SEEN)/$(1).h5,$(guess_$(1)) $(way_$(way))))
$(foreach way,$(tenfold),$(call estimated,$(1),$(way),$(SEEN)/$(1).h5,$(guess_$(1)) $(call way_$(way),$(1))))
$(call estimated,$(1),markers,$(SEEN)/$(1)_markers.csv,$(guess_$(1)) $(way_markers))
$(call estimated,$(1),points,$(SEEN)/$(1)_points.npz,$(guess_$(1)) $(way_points))
$(call estimated,$(1),mismatched,$(SEEN)/$(1)_fine_markers.csv,$(guess_$(1)) $(way_mismatched))
$(call estimated,$(1),mismatched_third,$(SEEN)/$(1)_finest_markers.csv,$(guess_$(1)) $(way_mismatched))
$(call estimated,$(1),refined,$(SEEN)/$(1)_fine_markers.csv,$(guess_$(1)) $(way_refined))
$(call estimated,$(1),refined_third,$(SEEN)/$(1)_finest_markers.csv,$(guess_$(1)) $(way_refined))
endef

# $(call estimated,object,way,observation,options)
define estimated

$(ESTIMATES)/$(1)/$(2).json: | $(3)
	$$(RUN) pcnclaws.estimate material=$(call material_of,$(1)) observation.file=$(3) $(4) \
		threads=1 trajectory=false output=$(SEEN)/$(1)/$(2).json
	@mkdir -p $$(@D) && cp $(SEEN)/$(1)/$(2).json $$@

endef

$(foreach object,$(nine),$(eval $(call seen,$(object))))

# how many of the numbers of new objects lie in the intervals of the calibration that ships
define covered
$(ESTIMATES)/coverage_$(1).json: | $(INSTALLED)
	$$(RUN) pcnclaws.calibrate material=$(1) law=pretrained seed=1 objects=17 threads=1 output=$$@

endef
$(foreach material,$(FAMILY),$(eval $(call covered,$(material))))

# bodies whose stiffness differs from part to part
parts := several_bodies graded_body
vary_several_bodies := bodies
vary_graded_body := x
define estimated_parts
$(SEEN)/$(1).h5: | $(INSTALLED)
	$(VENV)/bin/python -m benchmarks.parts $(SEEN)
$(ESTIMATES)/$(1)/analytic.json: | $(SEEN)/$(1).h5
	$$(RUN) pcnclaws.estimate material=elasticity law=analytic observation.file=$(SEEN)/$(1).h5 vary=$(vary_$(1)) \
		threads=1 trajectory=false output=$(SEEN)/$(1)/analytic.json
	@mkdir -p $$(@D) && cp $(SEEN)/$(1)/analytic.json $$@ && cp $(SEEN)/$(1)/analytic_fit.png docs/images/$(1)_fit.png

endef
$(foreach one,$(parts),$(eval $(call estimated_parts,$(one))))

.PHONY: estimation
estimation: $(foreach object,$(nine),$(ways:%=$(ESTIMATES)/$(object)/%.json) $(ESTIMATES)/$(object)/markers.json $(ESTIMATES)/$(object)/points.json) \
	$(foreach object,$(firsts),$(patsubst %,$(ESTIMATES)/$(object)/%.json,$(tenfold) mismatched mismatched_third refined refined_third)) \
	$(FAMILY:%=$(ESTIMATES)/coverage_%.json) $(parts:%=$(ESTIMATES)/%/analytic.json) ## estimate the paper's nine objects in every way

# all nine of the mismatched ones: some hours
.PHONY: mismatched
mismatched: $(foreach object,$(nine),$(patsubst %,$(ESTIMATES)/$(object)/%.json,refined refined_third mismatched mismatched_third))
