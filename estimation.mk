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
# as the test objects of the data sets move
motion_1 := 'scene.velocity=[1.0,-1.5,-2.0]' 'scene.spin=[2.0,2.0,2.0]'
motion_2 := 'scene.velocity=[1.0,-1.5,-1.5]'
motion_3 := 'scene.velocity=[-0.5,-2.5,1.0]'

# ways of estimating
ways := analytic analytic_unscreened pretrained pretrained_unscreened adam
way_analytic := law=analytic
way_analytic_unscreened := law=analytic screening=0
way_pretrained := law=pretrained
way_pretrained_unscreened := law=pretrained screening=0
way_adam := law=pretrained screening=0 estimator=adam

material_of = $(firstword $(subst _, ,$(1)))
number_of = $(lastword $(subst _, ,$(1)))

# $(call seen,object): its motion by the analytic law
define seen
$(SEEN)/$(1).h5: | $(INSTALLED)
	$$(RUN) pcnclaws.simulate material=$(call material_of,$(1)) law=analytic $(truth_$(1)) $(motion_$(call number_of,$(1))) \
		scene.name=$(1) picture=false threads=1 output=$$@
$(foreach way,$(ways),$(call estimated,$(1),$(way)))
endef

# $(call estimated,object,way)
define estimated

$(ESTIMATES)/$(1)/$(2).json: | $(SEEN)/$(1).h5
	$$(RUN) pcnclaws.estimate material=$(call material_of,$(1)) observation.file=$(SEEN)/$(1).h5 $(guess_$(1)) $(way_$(2)) \
		threads=1 trajectory=false output=$(SEEN)/$(1)/$(2).json
	@mkdir -p $$(@D) && cp $(SEEN)/$(1)/$(2).json $$@

endef

$(foreach object,$(nine),$(eval $(call seen,$(object))))

.PHONY: estimation
estimation: $(foreach object,$(nine),$(ways:%=$(ESTIMATES)/$(object)/%.json)) ## estimate the paper's nine objects in every way
