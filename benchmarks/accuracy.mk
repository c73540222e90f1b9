# The rows of docs/results.md. `make accuracy` trains and evaluates what is missing; whatever was interrupted goes on
# where it was. A row is a law: outputs/accuracy/<material>_<row>, its errors docs/results/accuracy/<material>/<row>.
RESULTS := docs/results/accuracy
LAWS := outputs/accuracy
FAMILY := elasticity plasticine sand
OUTSIDERS := neo_hookean tresca

# pictures of -M that the page shows
shown_unseen := sheet
shown_geometry := sheet
shown_outside_range := map

# options of the training of each row
multi := training=thorough
short :=
kalman := training=kalman
quick := training=keyframes
single := training=keyframes regime=single_scene training.iterations=400
paper_training = training=$(if $(filter elasticity,$(1)),paper,paper_plastic)
multi_paper = model=pcnclaws_paper $(paper_training)
single_paper = model=pcnclaws_paper $(paper_training) regime=single_scene training.iterations=600
multi_positions := training=initial
long_positions := training=initial training.iterations=360
free_flow_positions := $(long_positions) model=pcnclaws_free_flow
structure := training=keyframes training.iterations=0
energy := model=pcnclaws_energy training=gauss_newton data.speed=9 data.spin=8
no_prior := training=keyframes model=pcnclaws_no_prior training.iterations=400
scenes_4 := training=keyframes data.train_scenes=4
scenes_8 := training=keyframes data.train_scenes=8
scenes_24 := training=keyframes data.train_scenes=24
SEEDS := seed_1 seed_2 seed_3 seed_4 seed_5 seed_6 seed_7
$(foreach name,$(SEEDS),$(eval $(name) := $(subst _,=,$(name))))
# as many simulated steps as `quick`
try_absolute_loss := training=keyframes training.loss=absolute
try_segments_of_100_steps := training=keyframes training.segment_length.first=100 training.segment_length.last=100 training.iterations=40
try_batches_of_20 := training=keyframes training.batch_segments=20 training.iterations=40
try_double_precision := training=keyframes precision=float64
try_width_128 := training=keyframes model.width=128
VARIATIONS := try_absolute_loss try_segments_of_100_steps try_batches_of_20 try_double_precision try_width_128

# tasks that each row is asked for
TASKS := reconstruction unseen long_term geometry unseen_motion resolution
PAPER_TASKS := reconstruction unseen long_term geometry
BRIEF := reconstruction unseen
tasks_multi := $(TASKS) outside_range
tasks_single := $(TASKS)
tasks_multi_paper := $(PAPER_TASKS)
tasks_single_paper := reconstruction long_term geometry
tasks_multi_positions := $(BRIEF)
tasks_long_positions := $(BRIEF)
tasks_free_flow_positions := $(BRIEF)
tasks_structure := $(PAPER_TASKS)
tasks_no_prior := $(PAPER_TASKS)
tasks_energy := $(TASKS) outside_range
tasks_kalman := $(TASKS) outside_range
tasks_quick := $(BRIEF)
tasks_scenes_4 := unseen
tasks_scenes_8 := unseen
tasks_scenes_24 := unseen
$(foreach name,short $(SEEDS),$(eval tasks_$(name) := $(BRIEF)))
$(foreach name,$(VARIATIONS),$(eval tasks_$(name) := unseen))
# a law of one scene is asked about its own one
evaluation_single := task.scene=train-00
evaluated_single := reconstruction long_term geometry unseen_motion
evaluation_single_paper := task.scene=train-00
evaluated_single_paper := $(tasks_single_paper)

# $(call row,material,row): its training and its tasks
define row
$(LAWS)/$(1)_$(2)/metrics.json: | $(INSTALLED)
	$$(RUN) pcnclaws.train experiment=$(1)_multi $($(2)) output=$(LAWS)/$(1)_$(2) threads=1 \
		data.folder=outputs/data/$(1)$(if $(filter energy scenes_% try_double_precision,$(2)),_$(2))

$(RESULTS)/$(1)/$(2)/training.json: $(LAWS)/$(1)_$(2)/metrics.json
	@mkdir -p $$(@D) && cp $$< $$@
$(foreach task,$(tasks_$(2)),$(call evaluation,$(1),$(2),$(task)))
ROWS += $(RESULTS)/$(1)/$(2)/training.json $(tasks_$(2):%=$(RESULTS)/$(1)/$(2)/%.json)
endef

# $(call evaluation,material,row,task): pictures stay beside the law; the analytic floor is measured once a material
define evaluation

$(RESULTS)/$(1)/$(2)/$(3).json: $(LAWS)/$(1)_$(2)/metrics.json
	$$(RUN) pcnclaws.evaluate material=$(1) law=$(LAWS)/$(1)_$(2) task=$(3) threads=1 \
		output=$(LAWS)/$(1)_$(2)/evaluation/$(3).json \
		$(if $(filter $(3),$(evaluated_$(2))),$(evaluation_$(2))) \
		$(if $(filter multi,$(2)),,picture=false may_diverge=true) \
		$(if $(and $(filter multi,$(2)),$(filter-out outside_range,$(3))),,floor=false)
	@mkdir -p $$(@D) && cp $(LAWS)/$(1)_$(2)/evaluation/$(3).json $$@
$(if $(filter multi,$(2)),$(foreach kind,$(shown_$(3)),	@cp $(LAWS)/$(1)_$(2)/evaluation/$(3)_$(kind).png $$(@D)))

endef

# $(call rows,names,materials)
rows = $(foreach name,$(1),$(foreach material,$(2),$(eval $(call row,$(material),$(name)))))
$(call rows,multi single,$(FAMILY))
$(call rows,multi_positions structure,$(FAMILY) $(OUTSIDERS))
$(call rows,long_positions free_flow_positions,tresca)
$(call rows,short kalman quick no_prior multi_paper single_paper scenes_4 scenes_8 scenes_24,$(FAMILY))
$(call rows,energy,elasticity)
$(call rows,$(SEEDS),sand)
$(call rows,$(VARIATIONS),elasticity sand)

.PHONY: accuracy
accuracy: $(ROWS) ## train and evaluate what docs/results.md lacks: hours, and it can be interrupted
